# SPDX-License-Identifier: Apache-2.0
"""The deformation node with its topics, parameters and messages: the only room with rclpy."""
