# SPDX-License-Identifier: MIT
"""What a Rerun recording of a run holds."""
