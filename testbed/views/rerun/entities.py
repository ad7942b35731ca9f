# SPDX-License-Identifier: MIT
"""Names of everything in a recording; readers of `recording.rrd` may rely on them (docs/views.md)."""

APPLICATION = "slam-testbed"
TIMELINE = "sim_time"
SCAN_TIMELINE = "scan"
FINAL_PASS_TIMELINE = "final_pass"
"""Steps of the final pass: 0 before it, 1 after it."""

WORLD = "/world"
"""The world's frame; the map's frame where no truth is known."""
TRUE_WALLS = "/world/truth/walls"
TRUE_MAP = "/world/truth/map"
"""The true map, in the recording of a drive without an estimate."""
TRUE_PATH = "/world/truth/path"
TRUE_ROBOT = "/world/truth/robot"
ODOMETRY = "/world/odometry"
"""The odometry's frame, aligned to the world's at the first scan."""
ODOMETRY_PATH = "/world/odometry/path"
SLAM = "/world/slam"
"""The map's frame, aligned to the world's at the first scan."""
MAP = "/world/slam/map"
"""Parent of the squares of the map (see `square`); the whole map where it never changes."""
PATH = "/world/slam/path"
"""Parent of the blocks of the path (see `block`)."""
ESTIMATED_ROBOT = "/world/slam/robot"
SCAN = "/world/slam/robot/scan"
PARTICLES = "/world/slam/particles"
PARTICLE_DOTS = "/world/slam/particle_dots"
PARTICLE_PATHS = "/world/slam/particle_paths"
DEAD_BRANCHES = "/world/slam/dead_branches"
COVARIANCE = "/world/slam/covariance"
PROPOSAL = "/proposal"
"""The map's frame once more, for the view of the proposal."""
PROPOSAL_PRIOR = "/proposal/prior"
PROPOSAL_SAMPLES = "/proposal/samples"
PROPOSAL_GAUSSIAN = "/proposal/gaussian"
PROPOSAL_SCAN = "/proposal/optimum/scan"
PROPOSAL_OPTIMUM = "/proposal/optimum"
PROPOSAL_EYE = "/proposal/eye"
"""The place that the view of the proposal looks at; it follows the robot and does not turn."""
AROUND = "/around"
"""The robot's estimated position in the world's frame, for a view that follows it and does not turn."""

NOW = "/now"
"""Where the robot is, by the estimate and by the truth, in words."""

COMPARE = "/compare"
"""The map's frame once more, for the views that compare particles."""
RANKS = ("best", "lightest", "most_different_a", "most_different_b")
EQUAL_WEIGHT = ", as all"
"""The end of the label of a particle that weighs the same as all others."""
FINAL = "/final"
"""The map's frame once more, for the views of the final pass."""
FINAL_STEPS = ("before", "after")
FINAL_LOOPS = ("closed_by_filter", "left_open", "rejected")
"""Kinds of the loops that the final pass found, below `loops` of each step."""
FINAL_TRUTH = "/final_truth/path"
"""The whole true path, in the world's frame."""

SYSTEMS = "/world/systems"
"""Parent of the layers of the systems that process one drive (see `system`)."""

POSITION_ERROR = "/metrics/position_error"
ANOTHER_BEST = "/metrics/position_error/another_best"
ANOTHER_BEST_EVENT = "another particle became the best"
"""How the event of that begins; others of the same time say more."""
HEADING_ERROR = "/metrics/heading_error"
ESS = "/metrics/ess"
ESS_VALUE = "/metrics/ess/value"
ESS_RESAMPLED = "/metrics/ess/resampled"
SPREAD = "/metrics/spread"
MATCHED = "/metrics/matched_share"
STAGES = "/metrics/stages"
WEIGHTS = "/filter/weights"
STATE = "/state"
ESTIMATE_STATE = "/state/estimate"
SELF_CHECK_STATE = "/state/self_check"
MATCHING_STATE = "/state/matching"
ROBOT_STATE = "/state/robot"
LOCALIZATION_STATE = "/state/localization"
EVENTS = "/events"
SETTINGS = "/settings"
LEGEND = "/legend"


def square(parent: str, index: tuple[int, int]) -> str:
    """A square of a map by its column and row, counted from the map's origin."""
    return f"{parent}/square_{index[0]}_{index[1]}"


def block(parent: str, number: int) -> str:
    """A block of a path by its number."""
    return f"{parent}/block_{number}"


def system(parent: str, name: str) -> str:
    """What belongs to one of several systems; the name is that of its directory, of letters, digits and ``._-``."""
    return f"{parent}/{name}"
