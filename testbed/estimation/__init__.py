# SPDX-License-Identifier: MIT
"""The filter of this package over a whole recording: mapping with the final pass, or localisation in a finished map."""
