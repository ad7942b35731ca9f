#!/bin/bash
# A sweep on a SLURM cluster: sbatch slurm.sh; the parts need no connection to each other, only a common file system.
# A part that was cut off is started again by the same command and goes on where it was.
#SBATCH --job-name=sweep
#SBATCH --array=0-7
#SBATCH --cpus-per-task=4
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail

SPEC=${SPEC:-study.toml}              # what is to be computed (docs/sweep.md)
OUT=${OUT:-study}                     # on the common file system
export TESTBED_CACHE=${TESTBED_CACHE:-${TMPDIR:-/tmp}/slam-testbed-${USER:-$UID}}  # compiled kernels: on the node's own disk

testbed warmup
testbed sweep "$SPEC" --out "$OUT" \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers "${SLURM_CPUS_PER_TASK:-1}"

# When all parts are done, once: testbed gather "$OUT"
