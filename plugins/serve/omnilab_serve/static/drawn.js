"use strict";
// Pictures that are drawn when they are first asked for, which takes seconds each: one at a time, for a browser has six connections to
// a host, and what else is asked for, the next page above all, would wait until one is free.
function drawNext() {
  const picture = document.querySelector("img[data-drawn]");
  if (!picture) return;
  picture.onload = picture.onerror = drawNext;
  picture.src = picture.dataset.drawn;
  delete picture.dataset.drawn;
}
addEventListener("load", drawNext); // the page is complete without them
