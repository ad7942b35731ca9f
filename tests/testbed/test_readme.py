# SPDX-License-Identifier: MIT
"""What the README promises: its example runs, its files exist, its dependencies are those of the package."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from packaging.version import Version

from eval.files.tum import read_tum
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.cli.shared.help_texts import HELP
from testbed.run.run_directory import RUN_FILES

ROOT = Path(__file__).parents[2]
XS = np.arange(-2.0, 2.0, 0.2)
"""Where the robot of the example takes its scans [m]."""
README = (ROOT / "README.md").read_text(encoding="utf-8")


def my_robot():
    """A robot that drives through a square room of 8 m and stops for each scan; its lidar has 180 beams."""
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    for number, x in enumerate(XS):
        with np.errstate(divide="ignore"):
            to_x = (np.where(np.cos(angles) > 0, 4.0, -4.0) - x) / np.cos(angles)
            to_y = np.where(np.sin(angles) > 0, 4.0, -4.0) / np.sin(angles)
        yield 0.5 * number, np.array([x, 0.0, 0.0]), np.zeros(3), np.minimum(to_x, to_y)


def true_map() -> OccupancyGrid:
    """The room: free within its walls, unknown outside."""
    probability = np.full((170, 170), np.nan, np.float32)
    probability[4:166, 4:166] = 1.0
    probability[5:165, 5:165] = 0.0
    return OccupancyGrid(probability=probability, resolution=0.05, origin=(-4.25, -4.25, 0.0))


EXAMPLES = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_library_examples_run_and_find_the_way(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"my_robot": my_robot}
    exec(compile(EXAMPLES[0], "README.md", "exec"), names)
    np.testing.assert_allclose(names["path"][-1], [3.8, 0.0, 0.0], atol=0.05)
    assert names["grid"].occupied.any()
    assert len(capsys.readouterr().out.splitlines()) == 20
    poses = np.column_stack([XS, np.zeros((len(XS), 2))])
    names |= {"truth": Trajectory(0.5 * np.arange(len(XS)), poses), "true_map": true_map()}
    exec(compile(EXAMPLES[1], "README.md", "exec"), names)
    outcome, error, agreement = capsys.readouterr().out.split()
    assert outcome == "ok"
    assert float(error) < 0.02
    assert float(agreement) > 0.9
    assert len(read_tum("estimate.tum")) == len(names["path"])


def test_the_example_of_a_comparison_names_its_systems(capsys):
    exec(compile(EXAMPLES[2], "README.md", "exec"), {})
    results = re.findall(r"^<Result (\S+)", capsys.readouterr().out, flags=re.MULTILINE)
    assert [name.strip(":,") for name in results] == ["odometry", "scan-matching", "gmapping"]


def test_the_gymnasium_example_maps_a_world_it_has_never_seen(capsys):
    assert len(EXAMPLES) == 4
    assert EXAMPLES[3].count("\n") <= 30
    names: dict[str, Any] = {}
    exec(compile(EXAMPLES[3], "README.md", "exec"), names)
    assert "of the floor mapped, collided: False" in capsys.readouterr().out
    assert names["info"]["coverage"] > 0.9
    assert names["rewards"].shape == (64,)


def test_every_dependency_is_explained():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
    names = {re.split(r"[ \[<>=;]", line)[0] for line in lines}
    table = README[README.index("| dependency | purpose |") :].split("\n\n")[0]
    cells = re.findall(r"^\| (.*?) \| \S.* \|$", table, flags=re.MULTILINE)[1:]
    assert {re.sub(r"\[.*", "", name) for cell in cells for name in cell.split(", ")} == names


def test_the_version_is_the_same_everywhere():
    """Python writes 1.0.0rc1 what others write 1.0.0-rc1."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    newest = re.search(r"^## \[(\d\S+)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert citation is not None
    assert newest is not None
    assert {Version(project), Version(citation[1]), Version(newest[1])} == {Version(project)}


def test_every_command_is_listed():
    commands = set(re.findall(r"`testbed ([a-z]+)", README))
    assert commands == set(HELP)


def test_files_it_names_are_those_of_a_run():
    table = README[README.index("## What comes out") : README.index("## How accurate")]
    files = set(re.findall(r"`([a-z_]+\.[a-z]+)`", table))
    assert files
    assert files <= set(RUN_FILES)
