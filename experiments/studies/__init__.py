# SPDX-License-Identifier: BSD-3-Clause
"""Studies of speed, growth, robustness and accuracy on simulated drives."""
