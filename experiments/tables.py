# SPDX-License-Identifier: BSD-3-Clause
"""Tables as text, Markdown, CSV, LaTeX and JSON."""
import csv
import io
import json
import re

MISSING = "-"
PAGE_WIDTH = 110  # characters of \footnotesize in two columns of a paper


class Cell(str):
    """Text with the value by which it is compared with others of its row."""

    def __new__(cls, text, value):
        cell = super().__new__(cls, text)
        cell.value = value
        return cell


class Table:
    """Rows of cells that are text, numbers with `digits` decimals, or None.

    best: min or max, which chooses the values of a row that Markdown and LaTeX
    show in bold; None: no value. period: values that many columns apart are
    compared.
    """

    def __init__(self, name, title, header, digits, best=None, period=1):
        self.name, self.title, self.header = name, title, header
        self.digits, self.best, self.period = digits, best, period
        self.rows = []

    def cell(self, value):
        """The text of a cell."""
        if value is None:
            return MISSING
        if isinstance(value, str):
            return value
        return f"{value:.{self.digits}f}"

    def cells(self, bold="{}"):
        """All rows as text; `bold` is the format of the best cells."""
        rows = []
        for row in self.rows:
            cells = [self.cell(v) for v in row]
            values = [getattr(v, "value", v) for v in row[1:]]
            for i, value in enumerate(values):
                known = [self.rounded(v)
                         for v in values[i % self.period::self.period]
                         if is_number(v)]
                if (self.best and len(known) > 1 and is_number(value)
                        and self.rounded(value) == self.best(known)):
                    cells[i + 1] = bold.format(cells[i + 1])
            rows.append(cells)
        return rows

    def add_mean(self):
        """A last row of means, over the rows that have all values."""
        values = [[getattr(v, "value", v) for v in row[1:]]
                  for row in self.rows]
        mean = mean_row([[v if is_number(v) else None for v in row]
                         for row in values])
        if mean:
            self.rows.append([f"mean of {mean[0]}", *mean[1]])

    def page_blocks(self, rows):
        """`rows`, of which the first is the header, cut into blocks of columns
        that fit a page; each starts with the first column."""
        widths = [max(map(len, column)) + 2 for column in zip(*rows)]
        blocks, width = [], PAGE_WIDTH
        for i in range(1, len(widths)):
            if width + widths[i] > PAGE_WIDTH:
                blocks.append([0])
                width = widths[0]
            blocks[-1].append(i)
            width += widths[i]
        return [[[row[i] for i in block] for row in rows] for block in blocks]

    def rounded(self, value):
        """A value as its cell shows it: equal cells are equally good."""
        return round(value, self.digits)

    def text(self):
        """Aligned columns for a terminal."""
        blocks = []
        for rows in self.page_blocks([self.header, *self.cells()]):
            widths = [max(map(len, column)) for column in zip(*rows)]
            blocks.append("\n".join(
                "  ".join(c.ljust(w) if i == 0 else c.rjust(w)
                          for i, (c, w) in enumerate(zip(row, widths)))
                for row in rows))
        return f"{self.title}\n" + "\n\n".join(blocks) + "\n"

    def markdown(self):
        """The title in bold, and the table."""
        return f"**{self.title}**\n\n" + markdown_table(
            self.header, self.cells("**{}**"), "---:")

    def csv(self):
        """Rows that start with the name of the table."""
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows(
            [["table", *self.header],
             *[[self.name, *row] for row in self.cells()]])
        return out.getvalue()

    def latex(self):
        """A table of the width of the page, with a caption. Columns that do
        not fit follow below the others."""
        def escape(text):
            return re.sub(r"([_%&#$])", r"\\\1", text)
        lines = [r"\begin{table*}", r"\centering", r"\footnotesize"]
        bold = r"\textbf{{{}}}"
        for rows in self.page_blocks([self.header, *self.cells(bold)]):
            header, *body = [" & ".join(map(escape, row)) + r" \\"
                             for row in rows]
            lines += [r"\begin{tabular*}{\textwidth}{@{\extracolsep{\fill}}l"
                      + "r" * (len(rows[0]) - 1) + "}",
                      header, r"\hline", *body, r"\end{tabular*}"]
        return "\n".join([*lines, rf"\caption{{{escape(self.title)}}}",
                          r"\end{table*}"]) + "\n"

    def json(self):
        """The values with all digits."""
        return {"name": self.name, "title": self.title,
                "header": self.header, "rows": self.rows}


def is_number(value):
    """True for values that can be compared."""
    return isinstance(value, (int, float))


def mean_row(rows):
    """The mean of each column over the rows that have all values, or None if
    these are fewer than two.

    rows: their values, each with the same number of columns.
    """
    complete = [row for row in rows if None not in row]
    if len(complete) < 2:
        return None
    return len(complete), [sum(column) / len(complete)
                           for column in zip(*complete)]


def markdown_table(header, rows, alignment="---"):
    """A Markdown table of texts; `alignment` of all columns but the first."""
    lines = ["| " + " | ".join(row) + " |" for row in [header, *rows]]
    lines.insert(1, "|---" + f"|{alignment}" * (len(header) - 1) + "|")
    return "\n".join(lines) + "\n"


def write(tables, path, description):
    """PATH.txt, .md, .csv, .tex and .json; prints the text, too.

    description: further entries of the JSON file.
    """
    text = "\n".join(t.text() for t in tables)
    print("\n" + text, end="")
    path.with_suffix(".txt").write_text(text)
    path.with_suffix(".md").write_text(
        "\n".join(t.markdown() for t in tables))
    path.with_suffix(".csv").write_text("\n".join(t.csv() for t in tables))
    path.with_suffix(".tex").write_text("\n".join(t.latex() for t in tables))
    path.with_suffix(".json").write_text(json.dumps(
        {**description, "tables": [t.json() for t in tables]}, indent=2)
        + "\n")
    print(f"\nwrote {path}.txt, .md, .csv, .tex and .json")
