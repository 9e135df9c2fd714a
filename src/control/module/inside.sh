#!/bin/bash
# Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
# Starts LinuxCNC for `polypod record`, in namespaces of its own: nothing of it can be left behind, and several run at once.
# inside.sh FOLDER MODULES CONFIGURATION SUBROUTINES
set -e
ip link set lo up
mount --bind "$1" /mnt
mount --bind "$3" /mnt/config
if [ -n "$4" ]; then mount --bind "$4" /mnt/subroutines; fi
mount -t tmpfs tmpfs /tmp
mkdir /tmp/stock
mount --bind "$2" /tmp/stock
mount -t tmpfs tmpfs "$2"
ln -s /tmp/stock/* "$2"
for module in /mnt/*.so; do
  rm -f "$2/${module##*/}"
  cp "$module" "$2/"
done
cd /mnt
export RTAPI_UID=65534 RTAPI_FIFO_PATH=/tmp/.rtapi_fifo HOME=/tmp PATH="/usr/bin:$PATH"
unset DISPLAY
exec linuxcnc -r record.ini < /dev/null
