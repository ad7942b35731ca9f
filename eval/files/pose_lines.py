# SPDX-License-Identifier: MIT
"""Lines of a text file with poses: which are a title, a header, or numbers of a pose."""

from __future__ import annotations

from eval.files.named_columns import NamedColumns, named_columns
from eval.files.unnamed_columns import NINE, of_topic_echo

COLUMNS = "t x y z qx qy qz qw"
"""Of the usual format."""
_WIDTHS = (8, 13, 17)
_MAX_TITLE = 3
"""So many lines in front of the poses may be a title or a header."""
_OTHER_FORMATS = {
    12: "KITTI poses, which have no stamps; put them in front of the lines: paste -d' ' times.txt poses.txt",
    4: "'t x y yaw'; expected a quaternion, 0 0 sin(yaw/2) cos(yaw/2), or a first line 'timestamp x y yaw'",
    3: "'x y yaw' without stamps",
    7: "'t x y z roll pitch yaw'; expected a quaternion: 0 0 sin(yaw/2) cos(yaw/2)",
    16: "4 x 4 matrices without stamps, or numbers with decimal commas; expected points: tr , . < poses.txt",
}
_OTHER_TEXT = {"VERTEX_SE2": "g2o", "ODOM": "CARMEN", "FLASER": "CARMEN", "<?xml": "XML", "{": "JSON", "[{": "JSON"}
"""First words of other formats of text."""


class PoseLines:
    """Takes the lines of a file one after the other, and keeps the numbers of those that hold a pose."""

    def __init__(self) -> None:
        self.rows: list[list[float]] = []
        """The numbers of each pose."""
        self.numbers: list[int] = []
        """The line of each pose, from 1."""
        self.stamps: list[str] = []
        """The stamp of each pose as the file has it; empty where two columns hold it."""
        self.notes: list[str] = []
        """What was recognised."""
        self.empty = 0
        """Lines of other topics, without any pose."""
        self._titles = 0
        self._named: NamedColumns | None = None
        self._commented: NamedColumns | None = None

    def take(self, number: int, text: str) -> None:
        """Take in a line. Raises ValueError, saying what was expected, where it is no line of poses."""
        line = text.replace('"', "")
        fields = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not self.rows and self._is_header(number, line, fields):
            return
        if not fields or self._has_no_pose(line):
            return
        self.rows.append(_row(line, fields, self.rows, self._named))
        self.numbers.append(number)
        self.stamps.append(fields[0] if self._named is None else self._named.stamp_text(line))

    @property
    def states_angles(self) -> bool:
        """Whether a header states the unit of headings."""
        return self._named is not None and self._named.states_angles

    def _is_header(self, number: int, line: str, fields: list[str]) -> bool:
        """Whether a line in front of the poses is a comment, a title or a header, which is kept."""
        if not fields:
            self._commented = _in_comment(line) or self._commented
            return True
        if self._named is None and self._commented is not None and len(fields) == len(self._commented.names):
            self._named = self._commented
            self.notes.append("a comment is read as a header that names the columns")
        is_text = not any(map(_is_number, fields)) if self._named else not _is_number(fields[0].strip("[("))
        if self._titles == _MAX_TITLE or not is_text:
            return False
        if kind := _OTHER_TEXT.get(fields[0]) or ("JSON" if fields[0].startswith("{") else None):
            raise ValueError(f"expected poses '{COLUMNS}', got {kind}")
        found = named_columns(line)
        self._named = found or self._named
        self._titles += 1
        what = "a title" if found is None else "a header that names the columns"
        self.notes.append(f"line {number} is read as {what}")
        return True

    def _has_no_pose(self, line: str) -> bool:
        """Whether a line names the columns again, as of files that were joined, or is that of another topic."""
        if self._named is None:
            return False
        is_empty = self._named.is_empty(line)
        self.empty += is_empty
        return is_empty or self._named.is_header(line)


def _in_comment(line: str) -> NamedColumns | None:
    """Return the columns that a comment names; None where it names none, or the usual ones in their order."""
    try:
        found = named_columns(line.strip().lstrip("#").strip())
    except ValueError:
        return None
    usual = (
        found is not None
        and (*found.stamp, *found.position, *found.rotation) == tuple(range(8))
        and len(found.names) == 8
    )
    if found is None or usual:
        return None
    return found


def _row(line: str, fields: list[str], before: list[list[float]], named: NamedColumns | None) -> list[float]:
    """Return the numbers of a line; ValueError where they are not those of a pose, or not as many as before."""
    if named is not None:
        return named.pose(line)
    if (echoed := of_topic_echo(line)) is not None:
        return echoed
    if "" in _inner_cells(line):
        raise ValueError("expected numbers, got an empty cell; a first line that names the columns tells which")
    if before and len(fields) != len(before[0]):
        columns = f" '{COLUMNS}'" if len(before[0]) == 8 else " as in the lines before"
        raise ValueError(f"expected {len(before[0])} numbers{columns}, got {len(fields)}")
    if len(fields) not in (*_WIDTHS, NINE):
        raise ValueError(wrong_width(len(fields)))
    try:
        return [float(field) for field in fields]
    except ValueError:
        raise ValueError(f"expected {len(fields)} numbers, got '{line.strip()[:80]}'") from None


def _inner_cells(line: str) -> list[str]:
    """Cells between commas, or semicolons, without empty ones at the end."""
    separator = ";" if ";" in line else ","
    return [cell.strip() for cell in line.partition("#")[0].strip().rstrip(" ,;").split(separator)]


def wrong_width(count: int) -> str:
    """Say that a line has so many numbers, and what that looks like."""
    other = _OTHER_FORMATS.get(count)
    return f"expected 8 numbers '{COLUMNS}', got {count}{f', which looks like {other}' if other else ''}"


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
