# SPDX-License-Identifier: BSD-3-Clause
"""Readers of files that others wrote: a malformed one is one line."""
import functools
import json
import math
import struct

# The errors of parsing text or bytes.
MALFORMED = (ValueError, KeyError, IndexError, struct.error)


def names_its_file(reader):
    """Makes a reader, whose first argument is a path, end with one line that
    names the file if that is malformed."""
    @functools.wraps(reader)
    def read(path, *arguments):
        try:
            return reader(path, *arguments)
        except MALFORMED as error:
            what = (f"{error} is missing" if isinstance(error, KeyError)
                    else str(error))
            raise SystemExit(f"{path} is not as expected: {what}; copy it "
                             "again from its source") from None
    return read


@names_its_file
def read_json(path):
    """The content of a JSON file."""
    return json.loads(path.read_text())


def numbers_of(text):
    """The finite numbers of a line; throws ValueError."""
    numbers = [float(word) for word in text.split()]
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"'{text.strip()}' has a number that is not finite")
    return numbers
