# SPDX-License-Identifier: Apache-2.0
"""Pictures, tables and one offline page for each comparison."""
