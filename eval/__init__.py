# SPDX-License-Identifier: MIT
"""Measures of trajectories and maps, outcome labels, and the report of a run; docs/metrics.md explains each number.

    from eval.files.tum import read_tum                     # trajectories in and out
    from eval.files.map_server import read_map              # maps in and out
    from eval.scoring import score, score_files             # all measures as one nested dict: metrics.json
    from eval.limits import check                           # which limits a score breaks
    from eval.report.run_report import write_report         # one run directory -> report.html
    from eval.report.comparison import write_comparison     # several run directories -> comparison.html
    from eval.sweep.report import write_sweep_report  # the tables of a sweep -> sweep.html, figures, tables for a paper

Import from the modules: a bare `import eval` hides the builtin. This package itself imports nothing.
"""
