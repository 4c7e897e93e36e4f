// The table of many sets.

const kOverviewColumns = [
  {key: "object", label: "Object"},
  {key: "hand", label: "Hand"},
  {key: "version", label: "Version", number: true, show: (s) => String(s.version)},
  {key: "trials", label: "Trials", number: true, show: (s) => count(s.trials)},
  {key: "share", label: "Force closed", number: true, show: (s) => percent(s.closed, s.trials), bar: (s) => s.share},
  {key: "grasps", label: "Grasps", number: true, show: (s) => count(s.grasps)},
  {
    key: "best",
    label: "Best epsilon",
    number: true,
    show: (s) => s.grasps ? quantity(s.best) : "-",
    bar: (s) => s.best
  },
  {key: "seconds", label: "Core time", number: true, show: (s) => seconds(s.seconds)},
];

class Overview {
  constructor(page, data) {
    this.sets = data.sets.map((set) => ({...set, share: set.trials > 0 ? set.closed / set.trials : 0}));
    this.order = {key: "object", falls: false};
    this.search = element("input", {
      type: "search",
      placeholder: "Filter by object or hand",
      "aria-label": "Filter by object or hand",
      oninput: () => this.fill()
    });
    this.head = element("tr");
    this.body = element("tbody");
    this.note = element("p", {class: "empty"});
    const grasps = data.sets.reduce((sum, set) => sum + set.grasps, 0),
          trials = data.sets.reduce((sum, set) => sum + set.trials, 0);
    page.replaceChildren(element(
        "section", {class: "overview"},
        element(
            "div", {class: "overview-head"}, element("h1", {}, `${count(data.sets.length)} grasp sets`),
            element(
                "p", {class: "lead"},
                `${count(grasps)} grasps of ${count(trials)} trials, from the database ${data.database}`),
            this.search),
        ...data.failures.map((failure) => element("p", {class: "failure"}, failure)),
        element(
            "div", {class: "scroll"}, element("table", {class: "sets"}, element("thead", {}, this.head), this.body)),
        this.note));
    this.fill();
  }

  fill() {
    const {key, falls} = this.order, asked = this.search.value.trim().toLowerCase();
    const sets = this.sets.filter((set) => `${set.object} ${set.hand}`.toLowerCase().includes(asked));
    sets.sort((a, b) => (a[key] < b[key] ? -1 : a[key] > b[key] ? 1 : 0) * (falls ? -1 : 1));
    this.head.replaceChildren(
        element("th", {}, element("span", {class: "hidden"}, "Best grasp")),
        ...kOverviewColumns.map(
            (column) => element(
                "th", {
                  class: column.number ? "number" : "",
                  "aria-sort": column.key === key ? (falls ? "descending" : "ascending") : "none"
                },
                element(
                    "button", {
                      class: "plain",
                      onclick: () => {
                        this.order = {key: column.key, falls: column.key === key ? !falls : Boolean(column.number)};
                        this.fill();
                      }
                    },
                    column.label + (column.key === key ? (falls ? " \u2193" : " \u2191") : "")))));
    const most = Object.fromEntries(
        kOverviewColumns.map((c) => [c.key, Math.max(...this.sets.map((s) => c.bar ? c.bar(s) : 0), 1e-12)]));
    this.body.replaceChildren(...sets.map((set) => {
      const link = "#" + set.block;
      return element(
          "tr", {
            class: "link",
            onclick: () => {
              location.hash = link;
            }
          },
          element(
              "td", {class: "picture"},
              set.picture ? element("img", {
                src: set.picture,
                width: 132,
                height: 99,
                loading: "lazy",
                alt: `The best grasp of ${set.object} by ${set.hand}`
              }) :
                            element("div", {class: "no-picture"}, "no grasp")),
          ...kOverviewColumns.map((column) => {
            const text = column.show ? column.show(set) : set[column.key];
            return element(
                "td", {class: column.number ? "number" : "name"},
                column.key === "object" ? element("a", {href: link}, text) : text,
                column.bar ? element(
                                 "div", {class: "cell-bar"},
                                 element("div", {style: `width: ${100 * column.bar(set) / most[column.key]}%`})) :
                             null);
          }));
    }));
    this.note.textContent = sets.length ? "" : `No object or hand has "${this.search.value}" in its name.`;
  }

  close() {}
}
