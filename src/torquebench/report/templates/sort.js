// Sorts a table by the column whose title is clicked, or chosen by Enter; again for the other way round.
for (const title of document.querySelectorAll("table.sortable th")) {
  const sort = () => {
    const body = title.closest("table").tBodies[0];
    const column = [...title.parentNode.children].indexOf(title);
    const key = (row) => {
      const text = row.cells[column].textContent.trim();
      const number = parseFloat(text.replace(/^x/, ""));
      return Number.isNaN(number) ? text : number;
    };
    const order = title.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of title.parentNode.children) other.removeAttribute("aria-sort");
    title.setAttribute("aria-sort", order === 1 ? "ascending" : "descending");
    body.append(...[...body.rows].sort((a, b) => order * (key(a) > key(b) ? 1 : key(a) < key(b) ? -1 : 0)));
  };
  title.tabIndex = 0;
  title.addEventListener("click", sort);
  title.addEventListener("keydown", (event) => event.key === "Enter" && sort());
}
