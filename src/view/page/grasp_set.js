// One grasp set: its grasps in 3-D, filtered and browsed by rank, and where they come from.

const kDirections = [
  ["any", "any direction", null],
  ["-z", "from above (\u2212z)", [0, 0, -1]],
  ["+z", "from below (+z)", [0, 0, 1]],
  ["-x", "along \u2212x", [-1, 0, 0]],
  ["+x", "along +x", [1, 0, 0]],
  ["-y", "along \u2212y", [0, -1, 0]],
  ["+y", "along +y", [0, 1, 0]],
  ["view", "as I look now", null],
];
const kKeys = [
  ["\u2190 \u2192", "the grasp before, the next"],
  ["Page Up, Page Down", "ten grasps back, on"],
  ["Home, End", "the first, the last"],
  ["F", "see all of object and hand"],
  ["H S C A", "hand, samples, cones, all approaches: on or off"],
  ["R", "drop all filters"],
  ["T", "light or dark"],
  ["Drag, Shift and drag, wheel", "turn, shift, zoom"],
  ["Click a sample", "the best grasp from there"],
];

class GraspSetView {
  /** @param name  block of the set  @param first  number of the grasp shown first */
  constructor(page, name, first) {
    this.name = name;
    this.set = readBlock(name);
    this.hand = readBlock(this.set.hand_block);
    this.unpackAll();
    this.shown = -1;
    this.sort = {key: "rank", falls: false};
    this.layers = {hand: true, object: true, samples: true, cones: true, approaches: false};
    this.build(page);
    this.stage = new Stage(this.holder, `${this.set.object} with ${this.set.hand} in 3-D`);
    if (this.stage.isDrawing) this.drawScene();
    this.stage.onClick = (ray) => this.pick(ray);
    this.filter();
    this.show(this.order.includes(first) ? first : this.order.length ? this.order[0] : -1);
    this.frame();
    this.onKey = (event) => this.key(event);
    document.addEventListener("keydown", this.onKey);
  }

  unpackAll() {
    const {set} = this, grasps = {};
    for (const [key, value] of Object.entries(set.grasps)) grasps[key] = unpack(value);
    this.grasps = grasps;
    this.columns = set.columns.map((column) => ({...column, values: unpack(column.values)}));
    this.samples = Object.fromEntries(Object.entries(set.samples).map(([key, value]) => [key, unpack(value)]));
    this.passed = new Uint8Array(set.shown).fill(1);
    this.order = Uint32Array.from({length: set.shown}, (_, i) => i);
  }

  build(page) {
    const {set} = this;
    this.holder = element("div", {class: "canvas"});
    this.caption = element("div", {class: "caption"});
    this.buildFilters();
    this.buildNavigator();
    this.details = element("div", {class: "details"});
    this.buildRanking();
    const changed = () => this.applyLayers();
    const switches = element(
        "div", {class: "switches"}, toggle("Hand", this.layers, "hand", changed, "H"),
        toggle("Object", this.layers, "object", changed), toggle("Samples", this.layers, "samples", changed, "S"),
        toggle("Friction cones", this.layers, "cones", changed, "C"),
        toggle("All approaches", this.layers, "approaches", changed, "A"));
    const best = this.samples.best.reduce((a, b) => Math.max(a, b), 0);
    this.bestEpsilon = best;
    this.legend = legend("Best epsilon at each surface sample", "0", quantity(best), "no force closure");
    const empty = set.shown === 0 ?
        element(
            "p", {class: "empty"}, "This set holds no force-closed grasp. What became of its trials is told below.") :
        null;
    page.replaceChildren(
        element(
            "div", {class: "workbench"},
            element("aside", {class: "panel filters", "aria-label": "Filters"}, this.filterPanel),
            element(
                "section", {class: "view", "aria-label": "3-D view"}, this.holder, switches, this.legend, this.caption,
                empty, this.navigator),
            element("aside", {class: "panel facts-panel", "aria-label": "Grasp"}, this.details, this.ranking.node)),
        element("div", {class: "below"}, this.outcomes(), this.times(), this.provenance()));
  }

  // Filters -----------------------------------------------------------------------------------------------------------

  buildFilters() {
    const {set} = this, changed = () => this.filtersChanged();
    this.histograms = this.columns.map((column) => new RangeHistogram(column, changed));
    this.direction = element(
        "select", {
          "aria-label": "approach direction",
          onchange: () => {
            this.takeDirection();
            changed();
          }
        },
        ...kDirections.map(([value, label]) => element("option", {value}, label)));
    this.within = element("input", {
      type: "range",
      min: 5,
      max: 90,
      step: 5,
      value: 45,
      "aria-label": "degrees from the direction",
      oninput: () => {
        this.describeDirection();
        changed();
      }
    });
    this.withinText = element("output");
    this.axis = null;
    const used = new Set();
    for (let i = 0; i < set.shown; ++i) used.add(this.grasps.trial[3 * i + 2]);
    this.chips = set.preshapes.map((name, i) => {
      const input = element("input", {type: "checkbox", onchange: changed});
      input.checked = true;
      return {
        input,
        i,
        node: element(
            "label", {class: used.has(i) ? "chip" : "chip unused", title: used.has(i) ? "" : "no grasp"}, input,
            element("span", {}, name))
      };
    });
    this.summary = element("p", {class: "passed", "aria-live": "polite"});
    this.filterPanel = element(
        "div", {},
        element(
            "div", {class: "panel-head"}, element("h2", {}, "Filters"),
            element("button", {class: "plain", onclick: () => this.resetFilters(), title: "R"}, "Reset")),
        this.summary, ...this.histograms.map((h) => h.node),
        element(
            "div", {class: "group"},
            element(
                "div", {class: "histogram-head"},
                element(
                    "span", {class: "term", title: "From the palm to the object, in the object frame."},
                    "Approach direction"),
                this.withinText),
            this.direction, this.within),
        set.preshapes.length > 1 ?
            element(
                "div", {class: "group"},
                element("div", {class: "histogram-head"}, element("span", {class: "term"}, "Preshape")),
                element("div", {class: "chips"}, ...this.chips.map((chip) => chip.node))) :
            null);
    this.describeDirection();
  }

  takeDirection() {
    const [, , axis] = kDirections.find(([value]) => value === this.direction.value);
    this.axis = this.direction.value === "view" ? this.stage.toEye.negate().toArray() : axis;
    this.describeDirection();
  }

  describeDirection() {
    this.within.disabled = this.direction.value === "any";
    this.withinText.textContent = this.axis ? `within ${this.within.value}\u00b0` : "any";
  }

  resetFilters() {
    for (const histogram of this.histograms) histogram.reset();
    this.direction.value = "any";
    this.takeDirection();
    for (const chip of this.chips) chip.input.checked = true;
    this.filtersChanged();
  }

  filtersChanged() {
    this.filter();
    if (!this.passed[this.shown] || this.shown < 0)
      this.show(this.order.length ? this.order[0] : -1);
    else
      this.show(this.shown);
    if (this.layers.approaches) this.drawApproaches();
  }

  /** Which grasps pass, and their order. */
  filter() {
    const {grasps, passed} = this, least = Math.cos(this.within.valueAsNumber * Math.PI / 180) - 1e-9;
    const wanted = this.chips.map((chip) => chip.input.checked), axis = this.axis;
    const active = this.histograms.filter((h) => !h.isOpen);
    let n = 0;
    for (let i = 0; i < passed.length; ++i) {
      let ok = wanted[grasps.trial[3 * i + 2]] && active.every((h) => h.passes(i));
      if (ok && axis) {
        const a = grasps.approach;
        ok = axis[0] * a[3 * i] + axis[1] * a[3 * i + 1] + axis[2] * a[3 * i + 2] >= least;
      }
      passed[i] = ok ? 1 : 0;
      n += passed[i];
    }
    this.order = new Uint32Array(n);
    for (let i = 0, k = 0; i < passed.length; ++i)
      if (passed[i]) this.order[k++] = i;
    this.sortOrder();
  }

  sortOrder() {
    const {key, falls} = this.sort, sign = falls ? -1 : 1;
    const values = key === "rank" ? null : this.columns.find((column) => column.key === key).values;
    if (values) {  // unknown values stand at the end
      this.order.sort(
          (a, b) => Number.isNaN(values[a]) ? (Number.isNaN(values[b]) ? a - b : 1) :
              Number.isNaN(values[b])       ? -1 :
              values[a] === values[b]       ? a - b :
                                              sign * (values[a] - values[b] > 0 ? 1 : -1));
    } else {
      this.order.sort((a, b) => sign * (a - b));
    }
    const {set} = this;
    this.summary.textContent = `${count(this.order.length)} of ${count(set.shown)} grasps pass` +
        (set.shown < set.stored ?
             `; the set stores ${count(set.stored)}, the best ${count(set.shown)} are in this file` :
             "");
  }

  // Browsing ----------------------------------------------------------------------------------------------------------

  buildNavigator() {
    const step = (n) => () => this.move(n);
    this.slider = element("input", {
      type: "range",
      min: 0,
      max: 0,
      value: 0,
      "aria-label": "place in the ranking",
      oninput: () => this.show(this.order[this.slider.valueAsNumber])
    });
    this.place = element("output", {"aria-live": "polite"});
    this.navigator = element(
        "div", {class: "navigator"},
        element("button", {onclick: step(-1), "aria-label": "the grasp before", title: "\u2190"}, "\u2039"),
        this.slider, element("button", {onclick: step(1), "aria-label": "the next grasp", title: "\u2192"}, "\u203a"),
        this.place);
  }

  move(n) {
    if (!this.order.length) return;
    const at = Math.max(0, this.order.indexOf(this.shown));
    this.show(this.order[Math.min(this.order.length - 1, Math.max(0, at + n))]);
  }

  /** Puts a grasp on view, -1 for none. */
  show(i) {
    this.shown = i;
    const at = this.order.indexOf(i);
    this.slider.max = Math.max(0, this.order.length - 1);
    this.slider.value = Math.max(0, at);
    this.slider.disabled = this.order.length < 2;
    this.place.textContent = at < 0 ? "no grasp" : `${count(at + 1)} of ${count(this.order.length)}`;
    for (const histogram of this.histograms) histogram.draw(this.passed, i);
    this.describe();
    this.ranking.mark(this.sort.key, this.sort.falls);
    this.ranking.update(this.order, i);
    if (this.stage.isDrawing) this.drawGrasp();
    if (i >= 0) history.replaceState(null, "", `#${this.name}:${i}`);
  }

  /** The best grasp that passes at the sample that was clicked. */
  pick(ray) {
    if (!this.layers.samples) return;
    const [hit] = ray.intersectObject(this.sampleDiscs);
    if (!hit) return;
    const sample = discOf(this.sampleDiscs, hit.faceIndex);
    const best = this.order.reduce((a, i) => this.grasps.trial[3 * i] === sample && (a < 0 || i < a) ? i : a, -1);
    if (best >= 0)
      this.show(best);
    else
      this.caption.textContent = `No grasp that passes the filters comes from sample ${sample}.`;
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, textarea")) return;
    const steps = {
      ArrowLeft: -1,
      ArrowRight: 1,
      ArrowUp: -1,
      ArrowDown: 1,
      PageUp: -10,
      PageDown: 10,
      Home: -Infinity,
      End: Infinity,
      j: 1,
      k: -1
    };
    const layers = {h: "hand", s: "samples", c: "cones", a: "approaches"};
    if (event.key in steps) {
      this.move(steps[event.key]);
      event.preventDefault();
    } else if (event.key.toLowerCase() in layers) {
      const input = this.holder.parentElement.querySelector(`input[data-key=${layers[event.key.toLowerCase()]}]`);
      input.click();
    } else if (event.key.toLowerCase() === "f") {
      this.frame();
    } else if (event.key.toLowerCase() === "r") {
      this.resetFilters();
    }
  }

  buildRanking() {
    const text = (value) => value !== value ? "-" :
        !Number.isFinite(value)             ? "\u221e" :
                                              value.toFixed(
                                                  value >= 100    ? 0 :
                                                      value >= 10 ? 1 :
                                                      value >= 1  ? 2 :
                                                                    3);
    const columns = [
      {key: "rank", label: "Rank", text: (i) => count(i + 1)},
      ...this.columns.slice(0, 3).map(({key, brief, values}) => ({key, label: brief, text: (i) => text(values[i])}))
    ];
    this.ranking = new LongList(columns, {
      label: "grasps in order",
      show: (i) => this.show(i),
      sort: (key) => {
        this.sort = {
          key,
          falls: key === this.sort.key ? !this.sort.falls : key !== "rank" && key !== "critical_friction"
        };
        this.sortOrder();
        this.show(this.order.length ? this.order[0] : -1);
      },
    });
  }

  /** What is known of the grasp on view. */
  describe() {
    const {set, grasps, shown: i} = this;
    if (i < 0) {
      this.details.replaceChildren(
          element("h2", {}, "No grasp"),
          element(
              "p", {class: "empty"},
              set.shown > 0 ? "No grasp passes all filters. Widen one, or press R." : "There is none in this set."));
      this.caption.textContent = "";
      return;
    }
    const [sample, roll, preshape] = grasps.trial.slice(3 * i, 3 * i + 3), [, R, M] = set.trials;
    const begin = grasps.contact_begin[i], end = grasps.contact_begin[i + 1];
    const touching = new Set(grasps.contact_link.slice(begin, end));
    const approach =
        Array.from(grasps.approach.slice(3 * i, 3 * i + 3), (x) => x.toFixed(2).replace(/^-0\.00$/, "0.00"));
    const facts = this.columns.map(
        (column) =>
            [element("span", {class: "term", title: column.meaning}, column.label),
             quantity(column.values[i], column.unit)]);
    facts.push(
        ["Preshape", set.preshapes[preshape]],
        ["Contacts", `${end - begin} points on ${touching.size} link${touching.size === 1 ? "" : "s"}`],
        ["Approach", approach.join(", ")], ["Roll", `${(grasps.roll[i] * 180 / Math.PI).toFixed(1)}\u00b0`],
        ["Back-off", `${(1000 * grasps.backoff[i]).toFixed(1)}\u00a0mm`], [
          element(
              "span", {class: "term", title: `sample, roll, preshape; --trial ${(sample * R + roll) * M + preshape}`},
              "Trial"),
          `${sample}, ${roll}, ${preshape}`
        ]);
    const joints = this.hand.joints.map((joint, j) => {
      const q = grasps.joints[i * this.hand.joints.length + j];
      return [
        joint.name, joint.prismatic ? `${(1000 * q).toFixed(2)}\u00a0mm` : `${(q * 180 / Math.PI).toFixed(2)}\u00b0`
      ];
    });
    const pose = Array.from(grasps.pose.slice(7 * i, 7 * i + 7));
    const wasOpen = this.details.querySelector("details")?.open;
    const copied = element("button", {class: "plain", onclick: () => this.copy(copied)}, "Copy as JSON");
    this.details.replaceChildren(
        element(
            "div", {class: "panel-head"},
            element("h2", {}, `Grasp ${i}`, element("small", {}, `rank ${count(i + 1)} of ${count(set.stored)}`)),
            copied),
        factTable(facts),
        element(
            "details", {open: wasOpen}, element("summary", {}, "Pose and joints"), factTable([
              ["Position", pose.slice(0, 3).map((x) => (1000 * x).toFixed(1)).join(", ") + "\u00a0mm"],
              ["Quaternion", pose.slice(3).map((x) => x.toFixed(4)).join(", ")], ...joints
            ]),
            element("p", {class: "note"}, "The hand's root link in the object frame; quaternion x, y, z, w."),
            element("code", {}, `handhold render ${set.path}:${i} --out grasp.png`)));
    this.caption.textContent =
        `Contacts and their friction cones (friction ${set.friction}) in red; links that touch in blue.`;
  }

  async copy(button) {
    const {set, grasps, shown: i, hand} = this, J = hand.joints.length;
    const json = JSON.stringify({
      object: set.object,
      hand: set.hand,
      set_version: set.version,
      grasp: i,
      hand_pose: Array.from(grasps.pose.slice(7 * i, 7 * i + 7)),
      joint_names: hand.joints.map((joint) => joint.name),
      joint_position: Array.from(grasps.joints.slice(i * J, i * J + J))
    });
    try {
      await navigator.clipboard.writeText(json);
      button.textContent = "Copied";
    } catch (error) {
      button.textContent = "Not allowed here";
    }
  }

  // Drawing -----------------------------------------------------------------------------------------------------------

  drawScene() {
    const {set, stage, samples} = this;
    this.object = solid(
        readBlock(set.object_block), kObject, {polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1});
    this.drawnHand = new DrawnHand(this.hand);
    this.marks = new THREE.Group();
    this.objectRadius = boxOf([this.object]).getBoundingSphere(new THREE.Sphere()).radius;
    const radius =
        Math.min(0.36 * (set.pitch || typicalSpacing(samples.point, samples.normal)), 0.04 * this.objectRadius);
    this.sampleDiscs = discs(
        samples.point, samples.normal, radius,
        (i) => samples.best[i] > 0 ? scaleColour(samples.best[i] / this.bestEpsilon) : kNoValue);
    stage.scene.add(this.object, this.drawnHand.group, this.marks, this.sampleDiscs);
  }

  frame() {
    if (this.stage.isDrawing)
      this.stage.frame(boxOf(this.shown < 0 ? [this.object] : [this.object, this.drawnHand.group]));
  }

  drawGrasp() {
    const {grasps, shown: i, hand} = this;
    if (i >= 0) {
      const touching = new Set(grasps.contact_link.slice(grasps.contact_begin[i], grasps.contact_begin[i + 1]));
      this.drawnHand.pose(poseAt(grasps.pose, 7 * i), grasps.joints, i * hand.joints.length, touching);
    }
    this.drawContacts();
    this.applyLayers();
  }

  /** A ball at each contact, an arrow into the object, and the friction cone about it, its tip at the contact. */
  drawContacts() {
    for (const part of [...this.marks.children]) dispose(part);
    if (this.shown < 0) return;
    const {grasps} = this, scale = 0.9 * this.objectRadius, length = 0.24 * scale, mu = this.set.friction;
    for (let c = grasps.contact_begin[this.shown]; c < grasps.contact_begin[this.shown + 1]; ++c) {
      const p = new THREE.Vector3(...grasps.contact_position.slice(3 * c, 3 * c + 3));
      const n = new THREE.Vector3(...grasps.contact_normal.slice(3 * c, 3 * c + 3));
      const seenThrough = {color: kContact, depthTest: false, transparent: true};
      const ball = new THREE.Mesh(
          new THREE.SphereGeometry(0.022 * scale, 14, 10),
          new THREE.MeshBasicMaterial({...seenThrough, opacity: 0.95}));
      ball.position.copy(p);
      ball.renderOrder = 3;
      const cone = new THREE.Mesh(
          new THREE.ConeGeometry(mu * length, length, 28, 1, true),
          new THREE.MeshBasicMaterial({...seenThrough, opacity: 0.2, side: THREE.DoubleSide, depthWrite: false}));
      cone.geometry.translate(0, -length / 2, 0);  // its tip is the origin, it opens along -y
      cone.quaternion.setFromUnitVectors(new THREE.Vector3(0, -1, 0), n);
      cone.position.copy(p);
      cone.renderOrder = 1;
      cone.name = "cone";
      const line = new THREE.Line(
          new THREE.BufferGeometry().setFromPoints([p, p.clone().addScaledVector(n, length)]),
          new THREE.LineBasicMaterial(seenThrough));
      line.renderOrder = 2;
      line.name = "cone";
      this.marks.add(ball, cone, line);
    }
  }

  /** The way in of every grasp that passes, as a line that ends at its target point, coloured by epsilon. */
  drawApproaches() {
    if (this.approachLines) dispose(this.approachLines);
    const {grasps, order} = this, epsilon = this.columns.find((column) => column.key === "epsilon");
    const length = 0.35 * this.objectRadius, most = epsilon ? epsilon.values.reduce((a, b) => Math.max(a, b), 0) : 1;
    const position = new Float32Array(6 * order.length), colour = new Float32Array(6 * order.length);
    order.forEach((i, place) => {
      const k = order.length - 1 - place;  // of several on one line the first is drawn last, above the others
      const rgb = scaleColour(epsilon ? epsilon.values[i] / most : 0);
      for (let x = 0; x < 3; ++x) {
        position[6 * k + x] = grasps.target[3 * i + x];
        position[6 * k + 3 + x] = grasps.target[3 * i + x] - length * grasps.approach[3 * i + x];
        colour[6 * k + x] = colour[6 * k + 3 + x] = rgb[x];
      }
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
    this.approachLines =
        new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({vertexColors: THREE.VertexColors}));
    this.stage.scene.add(this.approachLines);
  }

  applyLayers() {
    if (!this.stage.isDrawing) return;
    const {layers} = this;
    this.object.visible = layers.object;
    this.sampleDiscs.visible = layers.samples;
    this.legend.classList.toggle("off", !layers.samples && !layers.approaches);
    this.drawnHand.group.visible = layers.hand && this.shown >= 0;
    for (const mark of this.marks.children) mark.visible = mark.name !== "cone" || layers.cones;
    if (layers.approaches && !this.approachLines) this.drawApproaches();
    if (this.approachLines) this.approachLines.visible = layers.approaches;
    this.stage.ask();
  }

  // Below: what became of the trials, times, provenance
  // ------------------------------------------------------------------

  outcomes() {
    const {set} = this, [N, R, M] = set.trials, all = N * R * M;
    const of = (name) => set.outcomes.find((outcome) => outcome.name === name)?.count ?? 0;
    // Each stage keeps what no outcome before it took away.
    const stages = [["Trials", `${count(N)} samples \u00d7 ${R} rolls \u00d7 ${M} preshapes`, all]];
    let left = all;
    for (const [label, ends] of [
             ["Closed on the object", ["not_run", "preshape_touches", "blocked_centering"]],
             ["Enough contacts", ["too_few_contacts"]], ["Decided", ["solve_failed"]],
             ["Force closed", ["not_force_closed"]], ["Free of itself", ["self_collision"]]]) {
      const lost = ends.reduce((sum, name) => sum + of(name), 0);
      left -= lost;
      if (lost > 0 || label === "Force closed") {
        stages.push([
          label,
          lost > 0 ? `\u2212${count(lost)}: ` +
                  ends.filter((name) => of(name) > 0)
                      .map((name) => set.outcomes.find((outcome) => outcome.name === name).meaning)
                      .join("; ") :
                     "",
          left
        ]);
      }
    }
    stages.push(
        ["Stored", set.stored < left ? "the best, or the most diverse, as the job says" : "all of them", set.stored]);
    const unknown = set.outcomes.filter((outcome) => outcome.count > 0 && outcome.meaning === "");
    return element(
        "section", {class: "card wide", id: "outcomes"}, element("h2", {}, "What became of the trials"),
        barChart(
            stages.map(([label, note, value], i) => ({
                         label,
                         note,
                         value,
                         text: `${count(value)}  (${percent(value, all)})`,
                         accent: i === stages.length - 1
                       })),
            all),
        ...unknown.map((outcome) => element("p", {class: "note"}, `${words(outcome.name)}: ${count(outcome.count)}`)));
  }

  times() {
    const {stages} = this.set, total = stages.reduce((sum, [, s]) => sum + s, 0),
          trials = this.set.trials.reduce((a, b) => a * b);
    const rows =
        stages.filter(([, s]) => s > 0)
            .sort((a, b) => b[1] - a[1])
            .map(([name, s]) => ({label: words(name), value: s, text: `${seconds(s)}  (${percent(s, total)})`}));
    return element(
        "section", {class: "card", id: "times"},
        element(
            "h2", {}, "Build time",
            element(
                "small", {},
                total > 0 ? ` ${seconds(total)} of one core, ${count(trials / total)} trials a second` : "")),
        rows.length ? barChart(rows, rows[0].value) :
                      element("p", {class: "empty"}, "The set says nothing of its build time."));
  }

  provenance() {
    return element(
        "section", {class: "card", id: "provenance"}, element("h2", {}, "Where it comes from"),
        factTable(this.set.facts),
        element("details", {}, element("summary", {}, "The job file"), element("code", {class: "file"}, this.set.job)));
  }

  close() {
    document.removeEventListener("keydown", this.onKey);
    this.stage.close();
  }
}
