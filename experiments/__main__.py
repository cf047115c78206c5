# SPDX-License-Identifier: BSD-3-Clause
"""`python3 -m experiments SUBCOMMAND`."""
from experiments import command_line

if __name__ == "__main__":
    command_line.main()
