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

TRUE_MODEL, ESTIMATED_MODEL = "/true_robot", "/estimated_robot"
ROBOT_MODELS = (TRUE_MODEL, ESTIMATED_MODEL)
"""Shapes of the URDF; their root frames hang on the robots above."""

COMPARE = "/compare"
"""The map's frame once more, for the views that compare particles."""
RANKS = ("best", "lightest", "most_different_a", "most_different_b")
FINAL = "/final"
"""The map's frame once more, for the views of the final pass."""
FINAL_STEPS = ("before", "after")
FINAL_TRUTH = "/world/truth/whole_path"

POSITION_ERROR = "/metrics/position_error"
HEADING_ERROR = "/metrics/heading_error"
ESS = "/metrics/ess"
ESS_VALUE = "/metrics/ess/value"
ESS_RESAMPLED = "/metrics/ess/resampled"
MATCHED = "/metrics/matched_share"
STAGES = "/metrics/stages"
WEIGHTS = "/filter/weights"
STATE = "/state"
ESTIMATE_STATE = "/state/estimate"
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
