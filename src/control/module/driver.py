#!/usr/bin/python3
# Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
# Takes the place of LinuxCNC's screen while `polypod record` runs: switches on, homes, runs the program, records, ends.
# Writes result.txt: "ok", or "failed WHERE LINE" and what LinuxCNC said, a line each.
import os
import subprocess
import sys
import time

import linuxcnc

command, status, messages = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()
folder = os.path.dirname(os.path.abspath(sys.argv[0]))
recorder = None
block_delete = True  # polypod record writes what the job says
moving = 0  # the line of the last move that was seen under way: what stops it clears that of LinuxCNC


def end(text):
    if recorder is not None:
        time.sleep(0.3)  # what the drives lag behind, and what the sampler has not written yet
        recorder.terminate()
        recorder.wait()
    with open(os.path.join(folder, "result.part"), "w") as out:
        out.write(text + "\n")
    os.rename(os.path.join(folder, "result.part"), os.path.join(folder, "result.txt"))
    sys.exit(0)


def complaints():
    out = []
    while True:
        message = messages.poll()
        if not message:
            return out
        if message[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            out.append(" ".join(message[1].split()))


def fail(where, said):
    time.sleep(0.1)
    said += complaints()
    status.poll()
    # The interpreter has read ahead; what stops the joints is about the move under way.
    of_joints = any(words in text for text in said for words in ("soft limit", "following error", " on joint "))
    line = moving if where == "motion" or (of_joints and moving > 0) else max(status.current_line, 0)
    end("\n".join(["failed %s %d" % (where, line)] + (said or ["LinuxCNC gave no message"])))


def until(where, reached, seconds):
    last = time.monotonic() + seconds
    while time.monotonic() < last:
        status.poll()
        said = complaints()
        if said:
            fail(where, said)
        if reached():
            return
        time.sleep(0.01)
    fail(where, ["no answer within %d s" % seconds])


command.state(linuxcnc.STATE_ESTOP_RESET)
command.wait_complete()
# The latch of the e-stop asks for an edge: once more where the first one came too early.
last = time.monotonic() + 10
while True:
    status.poll()
    if status.task_state >= linuxcnc.STATE_ESTOP_RESET or time.monotonic() > last:
        break
    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    time.sleep(0.1)
command.state(linuxcnc.STATE_ON)
command.wait_complete()
until("switch-on", lambda: status.task_state == linuxcnc.STATE_ON, 20)
command.mode(linuxcnc.MODE_MANUAL)
command.wait_complete()
command.teleop_enable(0)
command.wait_complete()
command.home(-1)
until("homing", lambda: all(status.homed[: status.joints]), 60)
command.mode(linuxcnc.MODE_AUTO)
command.wait_complete()
command.set_block_delete(block_delete)
command.wait_complete()
command.program_open(os.path.join(folder, "program.ngc"))
command.wait_complete()
until("reading", lambda: True, 5)
subprocess.run(["halcmd", "setp", "sampler.0.enable", "1"], check=True)
recorder = subprocess.Popen(["halsampler", "-t", os.path.join(folder, "samples.txt")])
time.sleep(0.2)
command.auto(linuxcnc.AUTO_RUN, 0)
command.wait_complete()
time.sleep(0.05)
idle = 0
while idle < 5:  # some polls in a row: between two blocks the machine may stand
    status.poll()
    said = complaints()
    if status.motion_line > 0 and not said and status.task_state == linuxcnc.STATE_ON:
        moving = status.motion_line
    if status.task_state != linuxcnc.STATE_ON:
        fail("motion", said + ["the machine was switched off"])
    if said:
        fail("program", said)
    if status.interp_state == linuxcnc.INTERP_PAUSED or status.paused:
        command.auto(linuxcnc.AUTO_RESUME)  # M0, M1
        command.wait_complete()
    still = status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and status.queue == 0
    idle = idle + 1 if still else 0
    time.sleep(0.01)
end("ok")
