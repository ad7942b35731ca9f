# SPDX-License-Identifier: MIT
"""The common end of `run` and `slam`: run the job, write the report, choose the exit status."""

from __future__ import annotations

from eval.limits import check
from eval.report.run_report import write_report
from testbed.cli.shared.console import announce_compilation, console, progress_line, results
from testbed.cli.shared.output import OutputOptions
from testbed.cli.shared.status import GATE_FAILED, INTERRUPTED
from testbed.cli.shared.summary import headline_table, watch_command
from testbed.run.execute import execute_job
from testbed.run.job import Job
from testbed.run.run_directory import RunDirectory
from testbed.views import Scene, moments_for_report, open_view


def run_and_report(job: Job, directory: RunDirectory, scene: Scene, output: OutputOptions) -> int:
    """Run the job with a progress line, write the report, print the headline figures.

    Returns the exit status.
    """
    with directory.marked(stage="the kernels were compiled"):
        announce_compilation()
        view = open_view(directory / "recording.rrd", scene, output.view_options)
    if view.address is not None:
        console.print(f"live view: {view.address}", soft_wrap=True)
    with progress_line() as watcher:
        metrics = execute_job(job, directory, watcher, view)
        if metrics["outcome"] in ("interrupted", "failed"):
            console.print(f"{metrics['outcome']}: {directory.path} keeps what there was")
            return INTERRUPTED if metrics["outcome"] == "interrupted" else GATE_FAILED
        watcher.stage("report")
        with directory.marked(metrics, stage="the report was written"):
            report = write_report(directory.path, moments_for_report(directory.path), watcher.part)
    results.print(headline_table(metrics, directory.path))
    for note in metrics["notes"]:
        if note.startswith(("mount: ", "final pass: ")):  # the others were printed before the run
            console.print(note, soft_wrap=True)
    broken = check(metrics, output.limits)
    for sentence in broken:
        console.print(f"limit broken: {sentence}")
    command = watch_command(metrics, directory.path)
    if command is not None:
        results.print(command)
    results.print(f"report: {report.resolve()}")
    view.wait()
    return GATE_FAILED if broken else 0
