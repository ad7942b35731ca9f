# SPDX-License-Identifier: MIT
"""Many runs: worlds or logs x seeds x variants x particle counts, on one machine or a cluster (docs/sweep.md).

`spec` says what is asked for, `plan` makes cells of it, `compute` carries one out, `worker`, `pool` and `cluster` carry
out many, `store` keeps them in a directory, `gather` makes tables of them.
"""
