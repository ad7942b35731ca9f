# SPDX-License-Identifier: MIT
"""Many runs: worlds or logs x seeds x variants x particle counts, on one machine or a cluster (docs/sweep.md).

`spec` holds what was requested and the cells (jobs) that follow from it, `execution` computes them, `store` keeps the
results in a directory, `gather` makes tables of them, `rerun_worst` repeats the worst runs with a recording.
"""
