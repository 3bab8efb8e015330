// Draws a plot when it comes near the window: a page of thirty zones opens at once, and prints whole.
addEventListener("DOMContentLoaded", () => {
  const dark = matchMedia("screen and (prefers-color-scheme: dark)");
  const figures = new Map();
  const lighter = {"#1b2430": "#e4e7ea", "#0b5c8a": "#6fb1ea", "rgba(11,92,138,.22)": "rgba(111,177,234,.25)",
    "#c2571a": "#f09a5e", "#5b6776": "#98a2ad", "#2e7d4f": "#6cc48f", "#3d8b4f": "#6cc48f", "#8a3b8f": "#d08fd6",
    "#a8841a": "#dcb84e", "#b3324b": "#f0849a", "#1f9aa0": "#5fd0d6"};
  const recoloured = (value, key) => {
    if (typeof value === "string") return lighter[value] ?? value;
    if (!value || typeof value !== "object" || key === "x" || key === "y") return value;
    if (Array.isArray(value)) return value.map((one) => recoloured(one));
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, recoloured(one, name)]));
  };
  const draw = (place, night) => {
    watcher.unobserve(place);
    const data = place.querySelector("script");
    if (data) {
      data.remove();
      figures.set(place, data.textContent);
    }
    if (!figures.has(place)) return;
    const figure = JSON.parse(figures.get(place));
    const shown = night ? recoloured(figure) : figure;
    if (night) {
      const template = shown.layout.template.layout;
      const lines = {gridcolor: "#2f353b", linecolor: "#2f353b", zerolinecolor: "#4a525a"};
      Object.assign(template, {paper_bgcolor: "#14171a", plot_bgcolor: "#14171a", font: {color: "#c3cad1"}});
      Object.assign(template.xaxis, lines);
      Object.assign(template.yaxis, lines);
    }
    Plotly.react(place, shown.data, shown.layout, {displaylogo: false, responsive: true});
  };
  const watcher = new IntersectionObserver(
    (seen) => seen.filter((one) => one.isIntersecting).forEach((one) => draw(one.target, dark.matches)),
    {rootMargin: "600px"});
  const places = document.querySelectorAll(".plot");
  places.forEach((place) => watcher.observe(place));
  const redraw = () => [...figures.keys()].forEach((place) => draw(place, dark.matches));
  dark.addEventListener("change", redraw);
  addEventListener("beforeprint", () => places.forEach((place) => draw(place, false)));
  addEventListener("afterprint", redraw);
});
