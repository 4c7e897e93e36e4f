// Starts the page: what it shows follows from its data and from the part of the address behind #.

/** Light or dark: as the system has it until someone chooses. */
const theme = {
  kept() {
    try {
      return localStorage.getItem("handhold-theme");
    } catch (error) {
      return null;
    }
  },
  apply() {
    const dark = this.kept() ? this.kept() === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    document.documentElement.dataset.theme = dark ? "dark" : "light";
  },
  change() {
    const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem("handhold-theme", next);
    } catch (error) { /* kept for this visit alone */
    }
    document.documentElement.dataset.theme = next;
  },
};

function showHelp(keys) {
  const dialog = element(
      "dialog", {
        class: "help",
        onclick: (event) => {
          if (event.target === dialog) dialog.close();
        },
        onclose: () => dialog.remove()
      },
      element("h2", {}, "Keys and pointer"), factTable(keys.map(([key, what]) => [element("kbd", {}, key), what])),
      element("button", {onclick: () => dialog.close()}, "Close"));
  document.body.append(dialog);
  dialog.showModal();
}

function drawBar(path, keys) {
  document.getElementById("bar").replaceChildren(
      element("span", {class: "brand"}, "Handhold"), ...path, element("span", {class: "spacer"}),
      element("button", {class: "plain", onclick: () => showHelp(keys), title: "?"}, "Keys"),
      element("button", {class: "plain", onclick: () => theme.change(), title: "T"}, "Light / dark"));
}

const sets = readBlock("sets"), plan = readBlock("plan");
let view = null, keys = kKeys, shownPlace = null;

/** #set-3:12 is grasp 12 of set 3. */
function placeOf(hash) {
  const match = /^#(set-\d+)(?::(\d+))?$/.exec(hash);
  const known = match && sets.sets.find((set) => set.block === match[1]);
  return known               ? {set: known, grasp: Number(match[2] ?? 0)} :
      sets.sets.length === 1 ? {set: sets.sets[0], grasp: 0} :
                               null;
}

function showPlace() {
  const page = document.getElementById("page");
  if (view) view.close();
  if (plan) {
    keys = kPlanKeys;
    drawBar([element("h1", {}, plan.title), element("span", {class: "status " + plan.status}, plan.status)], keys);
    view = new PlanView(page, plan);
    return;
  }
  const place = placeOf(location.hash);
  shownPlace = place ? place.set.block : null;
  if (!place) {
    drawBar([], keys);
    view = new Overview(page, sets);
  } else {
    drawBar(
        [
          sets.sets.length > 1 ? element("a", {href: "#"}, "All sets") : null,
          element("h1", {}, `${place.set.object} \u00d7 ${place.set.hand}`),
          element("span", {class: "version"}, `version ${place.set.version}`)
        ].filter(Boolean),
        keys);
    view = new GraspSetView(page, place.set.block, place.grasp);
  }
  window.scrollTo(0, 0);
}

theme.apply();
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, textarea")) return;
  if (event.key.toLowerCase() === "t") theme.change();
  if (event.key === "?" && !document.querySelector("dialog")) showHelp(keys);
});
window.addEventListener("hashchange", () => {
  const place = sets && placeOf(location.hash);
  if (!place || place.set.block !== shownPlace) return showPlace();
  const grasp = Math.min(place.grasp, view.set.shown - 1);
  if (!view.passed[grasp]) view.resetFilters();
  view.show(grasp);
});
showPlace();
// For tests and for the curious: what is shown.
window.handhold = {
  get view() {
    return view;
  },
  scaleColour,
  linkPoses,
  unpack
};
document.documentElement.dataset.ready = "true";
