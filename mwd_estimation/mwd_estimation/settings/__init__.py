# SPDX-License-Identifier: Apache-2.0
"""What users set: the tool, the place, the survey and the verdict, and the parameters of each filter from them."""
