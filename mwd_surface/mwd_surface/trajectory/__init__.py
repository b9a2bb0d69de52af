# SPDX-License-Identifier: Apache-2.0
"""The hole as a curve: well path, plan, slide sheet, trajectory between stations, advice on the next interval."""
