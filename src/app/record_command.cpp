// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <fstream>
#include <memory>
#include <sstream>

#include "interrupt.hpp"
#include "linuxcnc_commands.hpp"
#include "polypod/control/record.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string folder, program, out, job;
  double time_limit = 600;
  bool partial = false, live = false;
};

bool has_optional_blocks(const std::string& program) {
  const Result<std::string> text = files::read(program);
  if (!text) return false;
  std::istringstream lines(*text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find_first_not_of(" \t");
    if (first != std::string::npos && line[first] == '/') return true;
  }
  return false;
}

}  // namespace

Command record_command() {
  auto o = std::make_shared<Options>();
  return {
      "record", "What LinuxCNC does with a program on an exported machine: joints, tip and line every millisecond",
      "polypod record hexapod hexapod/example.ngc -o record.csv",
      [o](Arguments& a) {
        a.positional("DIR", o->folder, "The folder that `polypod export linuxcnc` wrote");
        a.positional("PROGRAM", o->program, "The program; it starts at the machine's home, with empty offsets");
        a.option("-o,--output", o->out, "The record, CSV", true);
        a.option(
            "--job", o->job,
            "A job whose workpiece origin, rotation and work offsets become those of G54 to G59 (default: all 0), and "
            "whose block_delete is the switch (default: on, as LinuxCNC starts)");
        a.option("--time-limit", o->time_limit, {1, 86400}, "s, of the whole run, which is in real time (default 600)");
        a.flag("--partial", o->partial,
               "Of a program that fails, keep the record up to there (exit status as without)");
        a.flag("--live", o->live,
               "Write the rows as they come, for `polypod view` and `polypod watch --follow`; of a run that fails they "
               "stay");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_TRY(check_files({o->program, o->job}, {o->out}, context.json));
        control::RecordOptions options;
        options.time_limit = o->time_limit;
        options.partial = o->partial;
        if (!o->job.empty()) {
          POLYPOD_ASSIGN(job, machining::read_job(o->job));
          options.parameters = control::work_offset_parameters(job);
          options.block_delete = job.block_delete;
        }
        std::ofstream growing;
        if (o->live) {
          if (files::is_standard_output(o->out)) {
            return fail("AP274", "--live needs a file: rows that come while LinuxCNC runs are followed in it", {},
                        "give -o a file");
          }
          options.rows = [&](std::string_view rows) {
            // An earlier record stays until this one begins.
            if (!growing.is_open()) growing.open(o->out, std::ios::binary | std::ios::trunc);
            growing << rows << std::flush;
          };
        }
        double shown = 0;
        options.progress = [&](double seconds) {
          if (context.progress && seconds > shown + 1) {
            fmt::print(stderr, "\rrecording, {:.0f} s\x1b[K", seconds);
            std::fflush(stderr);
            shown = seconds;
          }
          return !interrupted() && growing;
        };
        const auto record = control::record(o->folder, o->program, options);
        if (shown > 0) fmt::print(stderr, "\r\x1b[K");
        if (!growing) return fail("FI101", fmt::format("cannot write {}", one_line(o->out)));
        if (!record) return tl::unexpected(record.error());
        if (!growing.is_open()) POLYPOD_TRY(files::write_whole(o->out, record->csv));
        if (record->failed) {
          Error error = *record->failed;
          error.message += fmt::format("; the {:.3f} s up to there are in {}", record->seconds, one_line(o->out));
          return tl::unexpected(error);
        }
        if (context.json) {
          print_json({{"samples", record->samples}, {"seconds", record->seconds}, {"lines", record->lines}});
        } else {
          fmt::print("{} samples over {:.3f} s, {} lines of the program\nwrote {}\n", record->samples, record->seconds,
                     record->lines, one_line(o->out));
          if (options.block_delete && has_optional_blocks(o->program)) {
            fmt::print("note     blocks that begin with / were left out: {}\n",
                       o->job.empty() ? "block delete is on, as LinuxCNC starts; a job sets the switch"
                                      : "block_delete of the job is on");
          }
        }
        return kDone;
      }};
}

}  // namespace polypod::app
