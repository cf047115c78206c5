# SPDX-License-Identifier: BSD-3-Clause
"""Experiments with mgsfm on data sets: drivers, peers, tables and figures.

Run `python3 -m experiments --help` from the root of the repository;
experiments/README.md describes the subcommands.
"""
