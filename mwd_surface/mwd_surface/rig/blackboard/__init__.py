# SPDX-License-Identifier: Apache-2.0
"""D-WIS blackboard: the manifest that describes the signals of this program, and the client that publishes them."""
