// Charts: histograms that filter, bars.

/** Round numbers that divide [low, high] into at most `most` parts. */
function niceTicks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough * (1 - 1e-9));
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i)
    ticks.push(Number((i * step).toPrecision(12)));
  return ticks;
}

const kPlot = {
  width: 252,
  height: 54,
  left: 6,
  right: 6,
  bottom: 18,
  bins: 42
};

/**
 * A histogram of a column with two handles that choose a range of it.
 * All grasps are light bars, those that pass all filters dark ones, the grasp that is shown a line.
 */
class RangeHistogram {
  constructor(column, changed) {
    this.column = column;
    const finite = column.values.filter(Number.isFinite);
    this.low = column.is_share ? 0 : finite.reduce((a, b) => Math.min(a, b), Infinity);
    this.high = column.is_share ? 1 : finite.reduce((a, b) => Math.max(a, b), -Infinity);
    if (this.low > 0 && this.low < 0.15 * this.high) this.low = 0;
    if (!(this.high > this.low)) this.high = this.low + (Math.abs(this.low) || 1) * 1e-3;
    this.unknown = column.values.length - finite.length;
    this.all = this.binned((i) => true);
    this.from = element("input", {type: "range", min: 0, max: 1000, value: 0, "aria-label": `least ${column.label}`});
    this.to =
        element("input", {type: "range", min: 0, max: 1000, value: 1000, "aria-label": `largest ${column.label}`});
    this.readout = element("output");
    this.plot = drawn("svg", {
      viewBox: `0 0 ${kPlot.width} ${kPlot.height + kPlot.bottom}`,
      role: "img",
      "aria-label": `Histogram of ${column.label}`
    });
    for (const input of [this.from, this.to]) {
      input.addEventListener("input", () => {
        if (this.from.valueAsNumber > this.to.valueAsNumber)
          (input === this.from ? this.to : this.from).value = input.value;
        this.describe();
        changed();
      });
    }
    this.node = element(
        "div", {class: "histogram"},
        element(
            "div", {class: "histogram-head"},
            element(
                "span",
                {title: column.meaning + (this.unknown ? ` ${count(this.unknown)} not known.` : ""), class: "term"},
                column.label + (column.unit ? ` [${column.unit}]` : "")),
            this.readout),
        this.plot, element("div", {class: "range"}, this.from, this.to));
    this.node.dataset.key = column.key;
    this.describe();
  }

  get isOpen() {
    return this.from.valueAsNumber === 0 && this.to.valueAsNumber === 1000;
  }
  get least() {
    return this.low + (this.high - this.low) * this.from.valueAsNumber / 1000;
  }
  get largest() {
    return this.low + (this.high - this.low) * this.to.valueAsNumber / 1000;
  }

  reset() {
    this.from.value = 0;
    this.to.value = 1000;
    this.describe();
  }

  /** Does grasp i pass? What is not known passes only where nothing is asked; unbounded is more than anything. */
  passes(i) {
    if (this.isOpen) return true;
    const value = this.column.values[i];
    const isMost = this.to.valueAsNumber === 1000;
    return (this.from.valueAsNumber === 0 ? value === value : value >= this.least) && (isMost || value <= this.largest);
  }

  describe() {
    this.readout.textContent =
        this.isOpen ? "any" : `${Number(this.least.toPrecision(3))} \u2013 ${Number(this.largest.toPrecision(3))}`;
    this.node?.classList.toggle("active", !this.isOpen);
  }

  binned(included) {
    const bins = new Uint32Array(kPlot.bins), values = this.column.values, scale = kPlot.bins / (this.high - this.low);
    for (let i = 0; i < values.length; ++i) {
      if (!Number.isFinite(values[i]) || !included(i)) continue;
      ++bins[Math.min(kPlot.bins - 1, Math.floor((values[i] - this.low) * scale))];
    }
    return bins;
  }

  /** @param passed  by grasp, 1 when it passes all filters  @param shown  the grasp that is shown, -1 for none */
  draw(passed, shown) {
    const inner = kPlot.width - kPlot.left - kPlot.right, most = Math.max(...this.all, 1), step = inner / kPlot.bins;
    const x = (value) => kPlot.left + inner * (value - this.low) / (this.high - this.low);
    // By the square root of the number: rare values stay visible beside frequent ones.
    const height = (n) => n === 0 ? 0 : Math.max(1, kPlot.height * Math.sqrt(n / most));
    const bars = (bins, name) => drawn("path", {
      class: name,
      d: Array
             .from(
                 bins,
                 (n, i) => n === 0 ? "" :
                                     `M${(kPlot.left + i * step).toFixed(2)} ${kPlot.height}v${
                                         (-height(n)).toFixed(2)}h${(step * 0.86).toFixed(2)}v${height(n).toFixed(2)}z`)
             .join("")
    });
    const parts = [
      bars(this.all, "bars-all"), bars(this.binned((i) => passed[i]), "bars-passed"),
      drawn("line", {class: "axis", x1: kPlot.left, x2: kPlot.width - kPlot.right, y1: kPlot.height, y2: kPlot.height})
    ];
    for (const tick of niceTicks(this.low, this.high, 5)) {
      const anchor = x(tick) < 20 ? "start" : x(tick) > kPlot.width - 20 ? "end" : "middle";
      parts.push(
          drawn("line", {class: "axis", x1: x(tick), x2: x(tick), y1: kPlot.height, y2: kPlot.height + 3}),
          drawn("text", {x: x(tick), y: kPlot.height + 14, "text-anchor": anchor}, String(tick)));
    }
    const value = shown >= 0 ? this.column.values[shown] : NaN;
    if (Number.isFinite(value)) {
      parts.push(drawn("line", {class: "here", x1: x(value), x2: x(value), y1: 0, y2: kPlot.height}));
    }
    this.plot.replaceChildren(...parts);
  }
}

/**
 * Horizontal bars. rows: [{label, note, value, text, accent}]; the longest bar is `most`.
 */
function barChart(rows, most) {
  return element(
      "div", {class: "bars"},
      ...rows.map(
          (row) => element(
              "div", {class: "bar-row"},
              element("div", {class: "bar-label"}, row.label, row.note ? element("small", {}, row.note) : null),
              element("div", {class: "bar-track"}, element("div", {
                        class: row.accent ? "bar accent" : "bar",
                        style: `width: ${most > 0 ? (100 * row.value / most).toFixed(3) : 0}%`
                      })),
              element("div", {class: "bar-value"}, row.text))));
}
