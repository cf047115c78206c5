# SPDX-License-Identifier: BSD-3-Clause
"""Drivers: each turns a data set into sequences and runs methods on them."""
