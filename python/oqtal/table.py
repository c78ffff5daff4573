"""Tables: columns of NumPy arrays by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl

#: Rows, and columns, shown of a large table.
SHOWN = 12
SHOWN_COLUMNS = 20


class Table(Mapping[str, NDArray[Any]]):
    """Columns of equal length; ``table["name"]`` is an array."""

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self._columns = {name: np.asarray(values) for name, values in columns.items()}

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._columns[name]
        except KeyError:
            begun = [column for column in self._columns if column.startswith(str(name))]
            near = begun or get_close_matches(str(name), self._columns, 1)
            remedy = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(self._columns)}"
            raise KeyError(f"no column `{name}`; {remedy}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return next((len(values) for values in self._columns.values()), 0)

    def where(self, mask: NDArray[np.bool_]) -> Table:
        """The rows for which ``mask`` is true."""
        return Table({name: values[mask] for name, values in self._columns.items()})

    def to_pandas(self) -> pd.DataFrame:
        """The table as a data frame of pandas."""
        import pandas as pd

        return pd.DataFrame(self._columns)

    def to_polars(self) -> pl.DataFrame:
        """The table as a data frame of Polars; NaN becomes null."""
        import polars as pl

        return pl.DataFrame(self._columns, nan_to_null=True)

    def _cells(self) -> list[list[str]]:
        """Names and cells of the first rows and columns as text."""

        def text(value: Any) -> str:
            if isinstance(value, (float, np.floating)):
                return "" if np.isnan(value) else f"{value:.4g}"
            return str(value)

        names, shown = list(self)[:SHOWN_COLUMNS], range(min(self.rows, SHOWN))
        return [names, *([text(self._columns[name][row]) for name in names] for row in shown)]

    def _rest(self) -> str:
        """The rows and columns that are not shown."""
        further = ((self.rows - SHOWN, "rows"), (len(self) - SHOWN_COLUMNS, "columns"))
        left = " and ".join(f"{count} further {what}" for count, what in further if count > 0)
        return left and f"… {left}"

    def __repr__(self) -> str:
        cells = self._cells()
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
        return "\n".join([*lines, self._rest()]).rstrip()

    def _repr_html_(self) -> str:
        from html import escape

        head, *rows = ([escape(cell) for cell in row] for row in self._cells())
        body = "".join("<tr><td>" + "</td><td>".join(row) + "</td></tr>" for row in rows)
        return f"<table><tr><th>{'</th><th>'.join(head)}</th></tr>{body}</table><p>{self._rest()}</p>"
