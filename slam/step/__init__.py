# SPDX-License-Identifier: MIT
"""What mapping and localisation share in each step: the scan intake, the report, the detection of loops."""
