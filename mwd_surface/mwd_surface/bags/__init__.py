# SPDX-License-Identifier: Apache-2.0
"""What a recording is made of: reading, writing, recording as it happens, and saving what is left of a damaged one."""
