// Sort the cards of runs, and show those whose name has a text.

const list = document.querySelector(".gallery"), [sort, find, count] = ["sort", "find", "count"].map((id) => document.getElementById(id));

function arrange() {
  const key = sort.value, cards = [...list.children], words = find.value.toLowerCase();
  const valueOf = ({ dataset }) => (key === "name" ? dataset.name : dataset[key] === undefined || dataset[key] === "" ? Infinity : Number(dataset[key]) * (key === "date" ? -1 : 1));
  cards.sort((a, b) => (key === "name" ? valueOf(a).localeCompare(valueOf(b), undefined, { numeric: true }) : valueOf(a) - valueOf(b) || 0));
  for (const card of cards) card.hidden = !card.dataset.name.toLowerCase().includes(words);
  list.append(...cards);
  const shown = cards.filter(({ hidden }) => !hidden).length;
  count.textContent = shown < cards.length ? `${shown} of ${cards.length}` : "";
}

for (const control of [sort, find]) control.addEventListener("input", arrange);
arrange();
