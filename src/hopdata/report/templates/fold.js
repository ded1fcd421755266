// Sections fold at their headings. Without this script all of them stand open, as they do in print.
{
  const sections = [...document.querySelectorAll("main > section")];
  const folds = sections.filter((section) => section.id !== "glance").map((section) => {
    const fold = document.createElement("details"), summary = document.createElement("summary");
    summary.append(section.querySelector("h2"));
    fold.append(summary, ...section.childNodes);
    section.append(fold);
    return fold;
  });
  const unfold = () => {
    const goal = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!goal) return;
    const inside = goal.closest("details");
    for (const fold of [inside, ...goal.querySelectorAll(":scope > details")]) if (fold) fold.open = true;
    goal.scrollIntoView();
  };
  addEventListener("hashchange", unfold);
  document.addEventListener("click", (event) => event.target.closest("a[href='" + location.hash + "']") && unfold());
  addEventListener("beforeprint", () => folds.forEach((fold) => (fold.open = true)));
  unfold();
}
// In a narrow window the panels of the first picture stand one below the other, their letters as large as before.
const wide = document.querySelector("#glance-picture img");
if (wide && matchMedia("(max-width: 45rem)").matches) {
  const bytes = Uint8Array.from(atob(wide.src.split(",")[1]), (sign) => sign.charCodeAt(0));
  const drawn = new DOMParser().parseFromString(new TextDecoder().decode(bytes), "image/svg+xml").documentElement;
  const panels = [...drawn.querySelectorAll("[id^=axes_]")];
  document.body.append(drawn);
  const boxes = panels.map((panel) => panel.getBBox());
  drawn.remove();
  for (const [i, { x, y, width, height }] of boxes.entries()) {
    const image = wide.cloneNode(), view = { viewBox: [x, y, width, height].join(" "), width: `${width}pt`, height: `${height}pt` };
    for (const [key, value] of Object.entries(view)) drawn.setAttribute(key, value);
    panels.forEach((panel, k) => panel.setAttribute("visibility", k === i ? "visible" : "hidden"));
    image.src = "data:image/svg+xml," + encodeURIComponent(new XMLSerializer().serializeToString(drawn));
    image.style.setProperty("--paper", `${width}pt`);
    if (i) image.alt = "";
    wide.before(image);
  }
  wide.remove();
}
