# SPDX-License-Identifier: Apache-2.0
"""The hand as URDF: links, joints and simple meshes after the drawings of the manuals."""
