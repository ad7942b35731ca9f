# SPDX-License-Identifier: MIT
"""Programs as systems: what they get and leave, and that a crash, a hang and rubbish are one line."""

import os
import shlex
import sys
import time

import numpy as np
import pytest

from testbed.systems.errors import SystemFailedError, SystemsError
from testbed.systems.program import Program, group_megabytes
from tests.shell import call
from tests.testbed.systems.room import frames

WHEELS = """
import math, sys
dataset, out = sys.argv[1:3]
text = open(dataset).read()
assert "TRUEPOS" not in text, "the truth is in the recording"
with open(f"{out}/trajectory.tum", "w") as file:
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["ROBOTLASER1"]:
            beams = int(words[8])
            x, y, theta = map(float, words[9 + beams + 1 + 3 :][:3])
            print(words[-3], x, y, 0, 0, 0, math.sin(theta / 2), math.cos(theta / 2), file=file)
print("mapped", sys.argv[3:])
"""


def program(tmp_path, body, **limits):
    (tmp_path / "theirs.py").write_text(body)
    command = f"{shlex.quote(sys.executable)} {tmp_path / 'theirs.py'} {{dataset}} {{out}} {{seed}}"
    return Program(command=command, log_format="carmen", **limits)


def test_a_program_gets_the_recording_and_leaves_a_trajectory(tmp_path):
    drive = frames(scans=20)
    found = program(tmp_path, WHEELS, keep_log=tmp_path)
    assert found.name == "theirs"
    estimated, cost = found.run(drive, seed=5)
    scans = [frame for frame in drive if frame.scan is not None]
    at_scans = estimated.dense[estimated.at_scans]
    np.testing.assert_allclose(at_scans.stamps, [frame.stamp for frame in scans], atol=1e-6)
    np.testing.assert_allclose(at_scans.poses, [frame.odometry for frame in scans], atol=1e-5)
    assert (tmp_path / "program.log").read_text() == "mapped ['5']\n"
    assert cost.memory_mb > 1.0
    assert cost.ms_per_scan == pytest.approx(1e3 * cost.wall_s / 20)


def test_cpu_time_counts_that_of_children(tmp_path):
    body = (
        "import subprocess, sys, time\n"
        "busy = 'import time\\nend = time.process_time() + 0.6\\nwhile time.process_time() < end: pass'\n"
        "subprocess.run([sys.executable, '-c', busy])\n" + WHEELS
    )
    _, cost = program(tmp_path, body).run(frames(scans=5), seed=0)
    assert cost.cpu_s > 0.6


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        (
            "print('one\\ntwo\\nthree\\nfour'); raise SystemExit(7)",
            r"with exit status 7, .*last lines: two \| three \| four$",
        ),
        ("import os; os.kill(os.getpid(), 11)", "^theirs: ended by SIGSEGV"),
        ("print('done')", r"left nothing in \{out\}, expected trajectory.tum; its last lines: done"),
        ("import sys; open(sys.argv[2] + '/map.png', 'w')", r"left map.png in \{out\}, expected trajectory.tum"),
        (
            "import sys; open(sys.argv[2] + '/trajectory.tum', 'w').write('rubbish')",
            r"^theirs: trajectory.tum: expected poses",
        ),
        (
            "import sys; open(sys.argv[2] + '/trajectory.tum', 'w').write('0 nan 0 0 0 0 0 1\\n1 0 0 0 0 0 0 1\\n')",
            "^theirs: trajectory.tum",
        ),
        (WHEELS + "\nopen(out + '/map.yaml', 'w').write('image: [')", "^theirs: map.yaml"),
    ],
)
def test_what_goes_wrong_in_a_program_is_one_line(tmp_path, body, complaint):
    with pytest.raises(SystemFailedError, match=complaint) as caught:
        program(tmp_path, body).run(frames(scans=5), seed=0)
    assert "\n" not in str(caught.value)


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"


def test_a_program_that_hangs_ends_with_all_its_processes(tmp_path):
    body = (
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen(['sleep', '60']); open({str(tmp_path / 'pid')!r}, 'w').write(str(child.pid))\n"
        "print('waiting', flush=True); time.sleep(60)\n"
    )
    with pytest.raises(SystemFailedError, match="exceeded the time limit of 2 s; its last lines: waiting"):
        program(tmp_path, body, seconds=2.0).run(frames(scans=5), seed=0)
    assert not still_running(int((tmp_path / "pid").read_text()))


def still_running(pid: int) -> bool:
    """Whether a process runs after it had some time to end."""
    for _ in range(100):
        if not is_running(pid):
            return False
        time.sleep(0.05)
    return True


def test_what_a_program_leaves_running_is_ended(tmp_path):
    body = (
        "import subprocess\n"
        f"child = subprocess.Popen(['sleep', '60']); open({str(tmp_path / 'pid')!r}, 'w').write(str(child.pid))\n"
        + WHEELS
    )
    program(tmp_path, body).run(frames(scans=5), seed=0)
    assert not still_running(int((tmp_path / "pid").read_text()))


@pytest.mark.skipif(group_megabytes(os.getsid(0)) == 0.0, reason="only Linux says how much memory a process takes")
def test_a_program_that_takes_too_much_memory_is_ended(tmp_path):
    body = "import time; print('growing', flush=True); block = bytearray(400_000_000); time.sleep(60)"
    with pytest.raises(SystemFailedError, match="exceeded the memory limit of 200 MB; its last lines: growing"):
        program(tmp_path, body, megabytes=200.0).run(frames(scans=5), seed=0)


@pytest.mark.parametrize(
    ("command", "complaint"),
    [
        ("cp {out}", r"expected \{dataset\} in the command"),
        ("cp {dataset}", r"expected \{out\} in the command"),
        ("no-such-program {dataset} {out}", "no-such-program: no such program"),
        ("cp '{dataset} {out}", "No closing quotation"),
    ],
)
def test_commands_that_cannot_run_are_refused(command, complaint):
    with pytest.raises(SystemsError, match=complaint):
        Program(command=command)


@pytest.mark.usefixtures("without_pictures")
def test_a_program_and_a_class_are_compared(tmp_path):
    (tmp_path / "theirs.py").write_text(WHEELS)
    command = f"{shlex.quote(sys.executable)} {tmp_path / 'theirs.py'} {{dataset}} {{out}}"
    options = ("--system-command", command, "--system-format", "carmen", "--system", "odometry")
    drive = ("run", "office", "--backend", "fast", "--duration", "5")
    assert call(*drive, *options, "--out", tmp_path / "out") == 0
    files = {"odometry", "theirs", "comparison.html", "recording.rrd"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == files
    assert (tmp_path / "out" / "theirs" / "program.log").read_text() == "mapped []\n"
