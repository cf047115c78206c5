# SPDX-License-Identifier: BSD-3-Clause
"""Measures the benefit of each kind of prior knowledge.

Each case is a function of a Workbench that returns rows: (case, measured
quantity, value without the prior knowledge, value with it).
"""
