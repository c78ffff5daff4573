// Sorts the rows of every block of a table by the column of a heading, numbers before words; again: the other way round.
for (const head of document.querySelectorAll(".sheet thead th")) {
  head.tabIndex = 0;
  head.title = "sort by this column";
  const value = (row) => {
    const text = row.cells[head.cellIndex].textContent;
    const number = parseFloat(text);
    return Number.isNaN(number) ? [1, text] : [0, number];
  };
  const sort = () => {
    const table = head.closest("table");
    const down = head.ariaSort === "ascending";
    for (const other of table.tHead.rows[0].cells) other.ariaSort = null;
    head.ariaSort = down ? "descending" : "ascending";
    for (const block of table.tBodies) {
      const rows = [...block.rows].filter((row) => !row.classList.contains("variant"));
      const order = (a, b) => {
        const [x, y] = [value(a), value(b)];
        const less = x[0] !== y[0] ? x[0] - y[0] : x[1] < y[1] ? -1 : x[1] > y[1] ? 1 : 0;
        return down && x[0] === y[0] ? -less : less;
      };
      block.append(...rows.sort(order));
    }
  };
  head.addEventListener("click", sort);
  head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
}
