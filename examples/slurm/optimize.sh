#!/bin/sh
# Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
# A parameter study on several hosts under Slurm: sbatch examples/slurm/optimize.sh STUDY.toml FOLDER
# FOLDER lies on a file system that the first host can write; the others need nothing of it.
#SBATCH --job-name=polypod
#SBATCH --ntasks=32
#SBATCH --cpus-per-task=1
#SBATCH --time=12:00:00
#SBATCH --requeue
#SBATCH --signal=B:INT@120
# A job that ends at its time limit, or is requeued, goes on where it was: submit it again with the same arguments.
set -e
test $# -eq 2 || { echo "usage: sbatch $0 STUDY.toml FOLDER" >&2; exit 2; }
# --enable-recovery: a host that is lost costs its evaluations alone.
exec mpirun --enable-recovery -n "${SLURM_NTASKS:-2}" polypod optimize "$1" -o "$2"
