#!/bin/bash
# Recordings on a SLURM cluster: sbatch slurm_simulate.sh; the parts need only a common file system.
# A part that was cut off is started again by the same command and keeps the datasets that are complete.
#SBATCH --job-name=simulate
#SBATCH --array=0-7
#SBATCH --cpus-per-task=4
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail

WORLDS=${WORLDS:-generated:rooms*100} # what is driven (docs/datasets.md)
COUNT=${COUNT:-100}                   # drives in each world
OUT=${OUT:-data}                      # on the common file system
export TESTBED_CACHE=${TESTBED_CACHE:-${TMPDIR:-/tmp}/slam-testbed-${USER:-$UID}}  # compiled kernels: on the node's own disk

testbed warmup
testbed simulate "$WORLDS" --count "$COUNT" --out "$OUT" --format rosbag2-lean --draw lidar=lds01,rplidar_a2 \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers "${SLURM_CPUS_PER_TASK:-1}"

# When all parts are done, once: testbed datasets index "$OUT"
