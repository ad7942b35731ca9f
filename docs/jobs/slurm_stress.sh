#!/bin/bash
# A stress test on a SLURM cluster: sbatch slurm_stress.sh; each part turns one perturbation up, in a directory of its own.
# A part that was cut off is started again by the same command and goes on where it was.
#SBATCH --job-name=stress
#SBATCH --array=0-3
#SBATCH --cpus-per-task=8
#SBATCH --time=08:00:00
#SBATCH --requeue
set -euo pipefail

SYSTEMS=${SYSTEMS:-gmapping,scan-matching}                           # what is tested (docs/stress.md)
WORLDS=${WORLDS:-office,loop,maze}                                   # where
PERTURBATIONS=${PERTURBATIONS:-drop-scans slip people odometry-noise}  # one for each part of the array
OUT=${OUT:-stress}                                                   # on the common file system
export TESTBED_CACHE=${TESTBED_CACHE:-${TMPDIR:-/tmp}/slam-testbed-${USER:-$UID}}  # compiled kernels: on the node's own disk

read -r -a names <<<"$PERTURBATIONS"
name=${names[$SLURM_ARRAY_TASK_ID]}
testbed warmup
testbed stress "$SYSTEMS" --worlds "$WORLDS" --seeds "${SEEDS:-20}" --duration "${DURATION:-120}" \
    --perturbations "$name" --out "$OUT/$name" --workers "${SLURM_CPUS_PER_TASK:-1}"
