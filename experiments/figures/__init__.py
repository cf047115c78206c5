# SPDX-License-Identifier: BSD-3-Clause
"""Figures, drawn by matplotlib. Only modules of this package import it."""
