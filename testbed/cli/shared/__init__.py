# SPDX-License-Identifier: MIT
"""What several commands share: console, summary, exit statuses, config files, help texts."""
