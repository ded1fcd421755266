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
