// Sections fold at their headings. Without this script all are open, as in print.
{
  const sections = [...document.querySelectorAll("main > section")];
  const folds = sections.filter((section) => section.id !== "glance" && section.querySelector("h2")).map((section) => {
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
// What fits into the window needs no stop of the tab key; what is wider is scrolled by keys.
const stops = new ResizeObserver((seen) => seen.forEach(({ target }) => {
  const scrolls = target.scrollWidth > target.clientWidth + 1;
  target.tabIndex = scrolls ? 0 : -1;
  target.classList.toggle("wide", scrolls);
}));
document.querySelectorAll(".picture, .table, pre").forEach((one) => stops.observe(one));
const as_picture = (drawn) => new XMLSerializer().serializeToString(drawn)
  .replaceAll('<desc type="text/css"', '<style type="text/css"').replaceAll(/(<style type="text\/css"[^]*?)<\/desc>/g, "$1</style>");
// In a narrow window, stack the panels of a figure without shrinking their text.
if (matchMedia("(max-width: 45rem)").matches) document.querySelectorAll(".picture img[src*='svg']").forEach((wide) => {
  const room = 0.75 * document.querySelector("main").clientWidth / 0.8; // in points; panels shrink to 80 % at most
  const bytes = Uint8Array.from(atob(wide.src.split(",")[1]), (sign) => sign.charCodeAt(0));
  // The page's policy allows styles that a script sets, but none in a text: they wait under another name.
  const text = new TextDecoder().decode(bytes).replaceAll(' style="', ' data-style="').replaceAll("<style", "<desc").replaceAll("</style", "</desc");
  const drawn = new DOMParser().parseFromString(text, "image/svg+xml").documentElement;
  for (const one of drawn.querySelectorAll("[data-style]")) {
    one.style.cssText = one.dataset.style;
    one.removeAttribute("data-style");
  }
  const inside = (group, names) => names.flatMap((name) => [...group.querySelectorAll(`:scope > [id^=${name}_]`)]);
  const within = (one, other) => one.left >= other.left - 2 && one.right <= other.right + 2;
  // Axes above each other form one part, with the texts within their width; a half that fits stays whole.
  const parts = (group) => {
    const found = [], sides = (one) => {
      const { x, y, width, height } = one.getBBox();
      return { left: x, right: x + width, top: y, bottom: y + height, of: [] };
    };
    const join = (one, other) => {
      for (const side of ["left", "top"]) one[side] = Math.min(one[side], other[side]);
      for (const side of ["right", "bottom"]) one[side] = Math.max(one[side], other[side]);
      one.of.push(...other.of);
    };
    const boxed = (one) => {
      const clipped = [...one.querySelectorAll("[clip-path]")], show = (how) => clipped.forEach((path) => (path.style.display = how));
      show("none"); // a clipped line is longer than its visible part
      const found = { ...sides(one), of: [one] };
      show("");
      for (const clip of new Set(clipped.map((path) => path.getAttribute("clip-path"))))
        join(found, sides(drawn.querySelector(`${clip.slice(4, -1)} rect`)));
      return found;
    };
    // The columns of a legend for which the window is too narrow, as many beside each other as fit. Its letters
    // are small, so it is to be enlarged as panels are (.part in report.css).
    const enlarged = 0.8 * room / 1.2;
    const columnsOf = (legend) => {
      const columns = [], entry = []; // a handle, then its text
      for (const part of legend.children) {
        entry.push(boxed(part));
        if (!/^text/.test(part.id)) continue;
        const one = entry.splice(0).reduce((whole, more) => (join(whole, more), whole));
        const beside = columns.find((other) => one.left < other.right && other.left < one.right);
        if (beside) join(beside, one);
        else columns.push(one);
      }
      columns.sort((one, other) => one.left - other.left);
      return columns.reduce((rows, one) => {
        if (rows.length && one.right - rows.at(-1).left <= enlarged) join(rows.at(-1), one);
        else rows.push(one);
        return rows;
      }, []);
    };
    for (const one of inside(group, ["axes"]).map(boxed)) {
      const beside = found.filter((other) => one.left < other.right && other.left < one.right);
      for (const other of beside) join(one, found.splice(found.indexOf(other), 1)[0]);
      found.push(one);
    }
    for (const one of inside(group, ["legend", "text"]).map(boxed)) {
      // The label of an axis that all rows share stands beside the first column.
      const upright = one.bottom - one.top > 2 * (one.right - one.left);
      const beside = found.filter((other) => other.left >= one.right - 2).sort((a, b) => a.left - b.left)[0];
      const column = upright ? beside : found.find((other) => within(one, other));
      if (column) join(column, one);
      else if (one.right - one.left > enlarged) found.push(...columnsOf(one.of[0]));
      else found.push(one);
    }
    for (const half of inside(group, ["subfigure"])) {
      const whole = boxed(half);
      found.push(...(whole.right - whole.left > room ? parts(half) : [whole]));
    }
    // Columns of a grid stay beside each other as far as there is room, so that rows are read on.
    const columns = found.filter((one) => /^axes/.test(one.of[0].id)).sort((one, other) => one.left - other.left);
    const whole = columns.length > 2 ? columns.at(-1).right - columns[0].left : 0, share = whole / Math.ceil(whole / room);
    for (let k = 0; k + 1 < columns.length && whole; ) {
      if (columns[k + 1].right - columns[k].left > 1.05 * share) k++;
      else join(columns[k], found.splice(found.indexOf(columns.splice(k + 1, 1)[0]), 1)[0]);
    }
    const apart = (one, other) => one.bottom <= other.top + 4 || other.bottom <= one.top + 4;
    return found.sort((one, other) => (apart(one, other) ? one.top - other.top : one.left - other.left));
  };
  document.body.append(drawn);
  const figure = drawn.querySelector("[id^=figure_]"), found = figure ? parts(figure) : [];
  drawn.remove();
  const panels = found.filter((part) => /^(axes|subfigure)/.test(part.of[0].id));
  if (panels.length < 2 || panels.some(({ left, right }) => right - left > room)) return;
  const all = found.flatMap((part) => part.of);
  found.forEach(({ left, right, top, bottom, of }, number) => {
    const [width, height] = [right - left, bottom - top], image = wide.cloneNode();
    const view = { viewBox: [left, top, width, height].join(" "), width: `${width}pt`, height: `${height}pt` };
    for (const [key, value] of Object.entries(view)) drawn.setAttribute(key, value);
    all.forEach((one) => one.setAttribute("visibility", of.includes(one) ? "visible" : "hidden"));
    image.src = "data:image/svg+xml," + encodeURIComponent(as_picture(drawn));
    image.style.setProperty("--paper", `${width}pt`);
    image.classList.add("part");
    if (number) image.alt = "";
    wide.before(image);
  });
  wide.remove();
});
