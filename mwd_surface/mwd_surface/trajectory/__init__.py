# SPDX-License-Identifier: Apache-2.0
"""Well path, plan, slide sheet, trajectory between stations, and advice on the next interval."""
