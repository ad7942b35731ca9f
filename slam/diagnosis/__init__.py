# SPDX-License-Identifier: MIT
"""Whether the estimate can be right, from the filter's own evidence: beams that contradict the map, live and after."""
