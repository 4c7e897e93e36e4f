// A long table of which the rows in sight exist.

const kRowHeight = 26;  // px

class LongList {
  /**
   * @param columns  [{key, label, text: (row) => string, name}], name: true where it is no number
   * @param options  label: what the rows are; show(row): one was chosen; sort(key): a heading was
   */
  constructor(columns, options) {
    this.columns = columns;
    this.options = options;
    this.order = [];
    this.shown = -1;
    this.head = element("div", {class: "list-row list-head"}, ...columns.map((column) => {
      const button = element(
          "button", {
            class: column.name ? "plain name" : "plain",
            onclick: () => options.sort?.(column.key),
            disabled: !options.sort
          },
          column.label);
      button.dataset.key = column.key;
      return button;
    }));
    this.rows = element("div", {class: "list-rows"});
    this.scroll = element(
        "div",
        {class: "list-scroll", tabindex: 0, role: "listbox", "aria-label": options.label, onscroll: () => this.fill()},
        this.rows);
    this.node = element("div", {class: "list"}, this.head, this.scroll);
    new ResizeObserver(() => this.fill()).observe(this.scroll);
  }

  /** @param order  the rows in their order  @param shown  the row that is on view */
  update(order, shown) {
    this.order = order;
    this.shown = shown;
    const top = order.indexOf(shown) * kRowHeight, height = this.height;
    if (top < this.scroll.scrollTop || top + kRowHeight > this.scroll.scrollTop + height) {
      this.rows.style.height = `${order.length * kRowHeight}px`;
      this.scroll.scrollTop = Math.max(0, top) - height / 2 + kRowHeight / 2;
    }
    this.fill();
  }

  mark(key, falls) {
    for (const button of this.head.children) {
      button.classList.toggle("sorted", button.dataset.key === key);
      button.dataset.arrow = falls ? "\u2193" : "\u2191";
    }
  }

  get height() {
    return this.scroll.clientHeight || 200;
  }

  fill() {
    const n = this.order.length;
    this.rows.style.height = `${n * kRowHeight}px`;
    const first = Math.max(0, Math.floor(this.scroll.scrollTop / kRowHeight) - 2),
          last = Math.min(n, first + Math.ceil(this.height / kRowHeight) + 4);
    this.rows.replaceChildren(...Array.from({length: Math.max(0, last - first)}, (_, k) => {
      const row = this.order[first + k], isShown = row === this.shown;
      return element(
          "div", {
            class: isShown ? "list-row shown" : "list-row",
            role: "option",
            "aria-selected": String(isShown),
            style: `top: ${(first + k) * kRowHeight}px`,
            onclick: () => this.options.show(row)
          },
          ...this.columns.map((column) => element("span", {class: column.name ? "name" : ""}, column.text(row))));
    }));
  }
}
