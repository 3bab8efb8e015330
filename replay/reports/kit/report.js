// Tells below a chart what its axes say where the pointer is.
addEventListener("DOMContentLoaded", () => {
  const language = document.documentElement.lang;
  const date = new Intl.DateTimeFormat(language, {day: "numeric", month: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23", timeZone: "UTC"});
  const quantity = new Intl.NumberFormat(language, {maximumSignificantDigits: 3});
  const between = (text, share) => {
    const [low, high] = text.split(" ").map(Number);
    return low + share * (high - low);
  };
  for (const svg of document.querySelectorAll(".place > svg")) {
    const place = svg.parentElement.dataset;
    const chart = svg.closest(".chart");
    const told = chart.nextElementSibling.querySelector("output");
    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect();
      const x = between(chart.dataset.x, (event.clientX - box.left) / box.width);
      const y = between(place.y, (box.bottom - event.clientY) / box.height);
      told.textContent = ` · ${chart.hasAttribute("data-dated") ? date.format(1000 * x) : quantity.format(x)}: ${quantity.format("log" in place ? 10 ** y : y)}`;
    });
    svg.addEventListener("pointerleave", () => { told.textContent = ""; });
  }
});
