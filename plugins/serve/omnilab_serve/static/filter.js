"use strict";
// A search field with data-filter shows those of the elements it names that have all its words.
document.querySelectorAll("[data-filter]").forEach((field) => {
  const filter = () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    document.querySelectorAll(field.dataset.filter).forEach((element) => {
      element.hidden = !words.every((word) => element.textContent.toLowerCase().includes(word));
      shown += !element.hidden;
    });
    document.querySelectorAll("[data-filter-group]").forEach((group) => {
      group.hidden = !group.querySelector(`${group.dataset.filterGroup}:not([hidden])`);
    });
    document.querySelectorAll("[data-filter-none]").forEach((note) => (note.hidden = shown > 0));
  };
  field.addEventListener("input", filter);
  field.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    document.querySelector(`:is(${field.dataset.filter}):not([hidden])`)?.click();
  });
  filter();
});
