# SPDX-License-Identifier: Apache-2.0
"""D-WIS blackboard: the manifest that describes our signals, and the client that publishes them."""
