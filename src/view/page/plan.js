// A plan or a task: the scene over time, numbers on the target's surface, the ranking with what became of each grasp.

const kPlanKeys = [
  ["Space", "play, stop"],
  ["\u2190 \u2192", "a tenth of a second back, on"],
  ["Home, End", "to the start, to the end"],
  ["\u2191 \u2193", "the grasp before in the ranking, the next"],
  ["F", "see the whole scene"],
  ["G", "see the target from near"],
  ["T", "light or dark"],
  ["Drag, Shift and drag, wheel", "turn, shift, zoom"],
];
const kRoleColours = {
  robot: kRobot,
  hand: kPalm,
  object: kObject,
  obstacle: kObstacle
};
const kVerdicts = {
  planned: "the plan",
  hand_collision: "hand hits obstacle",
  target_collision: "hand hits target",
  unreachable: "out of reach",
  arm_collision: "arm collides",
  approach_broken: "approach breaks off",
  lift_blocked: "lift is blocked",
  no_motion: "no motion found",
  recheck_failed: "recheck fails",
};
const verdictText = (verdict) => verdict === "" ? "not tested" : kVerdicts[verdict] ?? words(verdict);

class PlanView {
  constructor(page, plan) {
    this.plan = plan;
    this.times = unpack(plan.time);
    this.duration = this.times[this.times.length - 1];
    this.now = 0;
    this.isPlaying = false;
    this.speed = 1;
    this.layers = {robot: true, obstacles: true, candidate: true};
    this.shownMap = -1;
    this.unpackRanking();
    this.shown = -1;
    this.build(page);
    this.stage = new Stage(this.holder, `${plan.title} in 3-D`);
    if (this.stage.isDrawing) this.drawScene();
    this.choose(this.ranking.verdict.indexOf("planned"));
    this.chooseMap(plan.maps.length ? 0 : -1);
    this.seek(0);
    this.frameAll();
    this.onKey = (event) => this.key(event);
    document.addEventListener("keydown", this.onKey);
  }

  unpackRanking() {
    const {ranking} = this.plan;
    this.ranking = {...ranking};
    for (const key of ["grasp", "hand", "score", "gq", "gb", "ge", "pose"]) this.ranking[key] = unpack(ranking[key]);
    this.order = Uint32Array.from({length: this.ranking.grasp.length}, (_, i) => i);
  }

  build(page) {
    const {plan} = this;
    this.holder = element("div", {class: "canvas"});
    this.legendHolder = element("div");
    this.candidateFacts = element("div", {class: "details"});
    this.buildTimeline();
    this.buildList();
    this.mapSelect = element(
        "select",
        {"aria-label": "what the target's surface shows", onchange: () => this.chooseMap(Number(this.mapSelect.value))},
        element("option", {value: -1}, "Target as it is"),
        ...plan.maps.map((map, i) => element("option", {value: i}, map.label)));
    const changed = () => this.applyLayers();
    const switches = element(
        "div", {class: "switches"}, toggle("Robot", this.layers, "robot", changed),
        toggle("Obstacles", this.layers, "obstacles", changed),
        this.order.length ? toggle("Chosen grasp", this.layers, "candidate", changed) : null,
        plan.maps.length ? this.mapSelect : null,
        element("button", {class: "plain", onclick: () => this.frameAll(), title: "F"}, "Whole scene"),
        element("button", {class: "plain", onclick: () => this.frameTarget(), title: "G"}, "Target"));
    const most = plan.rejected.reduce((a, [, n]) => Math.max(a, n), 0);
    const reasons = plan.rejected.slice()
                        .sort((a, b) => b[1] - a[1])
                        .map(([reason, n]) => ({label: verdictText(reason), value: n, text: count(n)}));
    page.replaceChildren(element(
        "div", {class: "workbench"},
        element(
            "aside", {class: "panel filters", "aria-label": "Plan"}, element("h2", {}, "What was planned"),
            factTable(plan.facts), element("h2", {class: "later"}, "Why grasps were rejected"),
            reasons.length ? barChart(reasons, most) :
                             element("p", {class: "empty"}, "None was: the first one tested works."),
            plan.maps.length ?
                element(
                    "div", {class: "maps"}, element("h2", {class: "later"}, "On the target"),
                    ...plan.maps.map(
                        (map, i) => element(
                            "button", {class: "map-choice", "data-map": i, onclick: () => this.chooseMap(i)},
                            element("b", {}, map.label), element("small", {}, map.meaning)))) :
                null),
        element(
            "section", {class: "view", "aria-label": "3-D view"}, this.holder, switches, this.legendHolder,
            this.timeline),
        element(
            "aside", {class: "panel facts-panel", "aria-label": "Ranking"},
            ...(this.order.length ? [this.candidateFacts, this.filterRow, this.list.node] :
                                    [element("h2", {}, "Steps"), ...this.buildSteps()]))));
  }

  // Time --------------------------------------------------------------------------------------------------------------

  buildTimeline() {
    const {plan} = this;
    if (!(this.duration > 0)) {
      this.timeline = element(
          "div", {class: "navigator"},
          element("p", {class: "empty"}, "There is no motion to play: nothing was planned."));
      return;
    }
    this.playButton =
        element("button", {onclick: () => this.play(!this.isPlaying), "aria-label": "play", class: "play"}, "\u25b6");
    this.slider = element("input", {
      type: "range",
      min: 0,
      max: this.duration,
      step: 0.001,
      value: 0,
      "aria-label": "time in seconds",
      oninput: () => {
        this.play(false);
        this.seek(this.slider.valueAsNumber);
      }
    });
    this.clock = element("output");
    this.speedSelect = element(
        "select", {
          "aria-label": "speed",
          onchange: () => {
            this.speed = Number(this.speedSelect.value);
          }
        },
        ...[0.25, 0.5, 1, 2, 4, 8].map((s) => element("option", {value: s, selected: s === 1}, `${s}\u00d7`)));
    this.stepText = element("span", {class: "step"});
    this.segmentStrip = element("div", {class: "segments"}, ...plan.segments.filter((s) => s.end > s.begin).map((s) => {
      const share = (s.end - s.begin) / this.duration, hasRoom = 280 * share > 6.5 * s.name.length + 6;
      const node = element(
          "button", {
            style: `flex: ${s.end - s.begin}`,
            title: `${s.note ? s.note + ": " : ""}${s.name}, ${(s.end - s.begin).toFixed(2)} s`,
            onclick: () => {
              this.play(false);
              this.seek(s.begin);
            }
          },
          hasRoom ? s.name : "");
      node.segment = s;
      return node;
    }));
    this.timeline = element(
        "div", {class: "navigator timeline"}, this.playButton,
        element("div", {class: "tracks"}, this.segmentStrip, this.slider), this.stepText, this.clock, this.speedSelect);
  }

  /** The steps of a task, each a way to its beginning. */
  buildSteps() {
    this.steps = [];
    for (const {note, begin, end} of this.plan.segments) {
      const last = this.steps[this.steps.length - 1];
      if (last && last.note === note)
        last.end = end;
      else
        this.steps.push({note, begin, end});
    }
    for (const step of this.steps) {
      step.node = element(
          "button", {
            class: "step-row",
            onclick: () => {
              this.play(false);
              this.seek(step.begin);
            }
          },
          element("b", {}, step.note), element("span", {}, `${step.begin.toFixed(1)} \u2013 ${step.end.toFixed(1)} s`));
    }
    return this.steps.length ? this.steps.map((step) => step.node) :
                               [element("p", {class: "empty"}, "No step was planned; the left side says why.")];
  }

  play(on) {
    if (!(this.duration > 0)) return;
    if (on && this.now >= this.duration) this.seek(0);
    this.isPlaying = on;
    this.playButton.textContent = on ? "\u275a\u275a" : "\u25b6";
    this.playButton.setAttribute("aria-label", on ? "stop" : "play");
    if (!on) return;
    let before = null;
    const step = (ms) => {
      if (!this.isPlaying) return;
      if (before !== null) this.seek(Math.min(this.duration, this.now + this.speed * (ms - before) / 1000));
      before = ms;
      if (this.now >= this.duration)
        this.play(false);
      else
        requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Shows everything as it is at a time [s]. */
  seek(time) {
    this.now = Math.min(this.duration, Math.max(0, time));
    if (this.stage.isDrawing) this.poseBodies();
    if (!(this.duration > 0)) return;
    this.slider.value = this.now;
    this.clock.textContent = `${this.now.toFixed(2)} / ${this.duration.toFixed(2)} s`;
    let current = null;
    for (const node of this.segmentStrip.children) {
      const s = node.segment, isHere = this.now >= s.begin && (this.now < s.end || s.end === this.duration);
      node.classList.toggle("here", isHere && current === null);
      if (isHere && current === null) current = s;
    }
    for (const step of this.steps ?? [])
      step.node.classList.toggle("here", this.now >= step.begin && (this.now < step.end || step.end === this.duration));
    this.stepText.textContent = current?.note ?? "";
  }

  /** Between two frames positions go straight and turns along the shortest arc. */
  poseBodies() {
    const {times, now} = this;
    let k = 0;
    for (let step = 1 << 16; step; step >>= 1)
      if (k + step < times.length && times[k + step] <= now) k += step;
    const next = Math.min(k + 1, times.length - 1), u = next > k ? (now - times[k]) / (times[next] - times[k]) : 0;
    const p = new THREE.Vector3(), q = new THREE.Quaternion(), one = new THREE.Vector3(1, 1, 1);
    for (const body of this.bodies) {
      if (body.poses.length > 7 || !body.isPlaced) {
        const a = body.poses.length > 7 ? 7 * k : 0, b = body.poses.length > 7 ? 7 * next : 0, n = body.poses;
        p.set(n[a], n[a + 1], n[a + 2]).lerp(new THREE.Vector3(n[b], n[b + 1], n[b + 2]), u);
        q.set(n[a + 3], n[a + 4], n[a + 5], n[a + 6])
            .slerp(new THREE.Quaternion(n[b + 3], n[b + 4], n[b + 5], n[b + 6]), u);
        body.object.matrix.compose(p, q, one);
        body.isPlaced = true;
      }
      body.isGone = body.gone_from >= 0 && now >= body.gone_from;
    }
    this.applyLayers();
  }

  // Ranking -----------------------------------------------------------------------------------------------------------

  buildList() {
    const {ranking: r, plan} = this;
    const columns = [
      {key: "rank", label: "Rank", text: (i) => count(i + 1)},
      {key: "score", label: "Score", text: (i) => r.score[i].toFixed(3)},
      {key: "verdict", label: "Outcome", name: true, text: (i) => verdictText(r.verdict[i])}
    ];
    this.list = new LongList(columns, {label: "grasps, best score first", show: (i) => this.choose(i)});
    this.list.node.classList.add("verdicts");
    const verdicts = [...new Set(r.verdict)];
    this.verdict = element(
        "select", {
          "aria-label": "outcome",
          onchange: () => {
            this.order = Uint32Array.from({length: r.grasp.length}, (_, i) => i)
                             .filter((i) => this.verdict.value === "all" || r.verdict[i] === this.verdict.value);
            this.choose(this.order.length ? this.order[0] : -1);
          }
        },
        element("option", {value: "all"}, "all outcomes"),
        ...verdicts.map((v) => element("option", {value: v}, verdictText(v))));
    this.filterRow = element(
        "div", {class: "list-filter"}, element("h2", {}, "Ranking", element("small", {}, ` of ${count(plan.ranked)}`)),
        this.verdict);
  }

  /** A grasp of the ranking as the hand would stand there; -1: none. */
  choose(i) {
    this.shown = i;
    this.list.update(this.order, i);
    const {ranking: r, plan} = this;
    if (i < 0) {
      this.candidateFacts.replaceChildren(
          element("h2", {}, "No grasp is chosen"),
          element("p", {class: "empty"}, "Choose one in the ranking to see where the hand would stand."));
    } else {
      const bar = (label, title, value, low) => element(
          "div", {class: "bar-row"},
          element("div", {class: "bar-label"}, element("span", {class: "term", title}, label)),
          element(
              "div", {class: "bar-track"},
              element("div", {class: "bar", style: `width: ${100 * Math.max(0, (value - low) / (1 - low))}%`})),
          element("div", {class: "bar-value"}, value.toFixed(3)));
      this.candidateFacts.replaceChildren(
          element(
              "div", {class: "panel-head"},
              element(
                  "h2", {}, `Grasp ${r.grasp[i]}`,
                  element("small", {}, `rank ${count(i + 1)} of ${count(plan.ranked)}`))),
          element(
              "div", {class: "bars"}, bar("Gq", "grasp quality, 0 to 1", r.gq[i], 0),
              bar("Gb", "robot position, \u22121 to 1", r.gb[i], Math.min(0, ...r.gb) < 0 ? -1 : 0),
              bar("Ge", "environment clearance, 0 to 1", r.ge[i], 0)),
          factTable([
            ["Score", r.score[i].toFixed(4)], ["Arm", r.arm[i]], ["Outcome", verdictText(r.verdict[i])],
            ...(r.detail[i] ? [["Because", r.detail[i]]] : [])
          ]));
    }
    if (this.stage.isDrawing) this.drawCandidate();
  }

  // Drawing -----------------------------------------------------------------------------------------------------------

  drawScene() {
    const {plan, stage} = this;
    this.bodies = plan.bodies.map((body, i) => {
      const object = solid(body.mesh, kRoleColours[body.role], behind(i));
      stage.scene.add(object);
      return {...body, mesh: null, object, poses: unpack(body.poses), isPlaced: false, isGone: false};
    });
    this.candidates = plan.hands.map(() => null);  // drawn when first chosen
  }

  drawCandidate() {
    const {ranking: r, shown: i} = this;
    if (i >= 0) {
      const h = r.hand[i];
      if (!this.candidates[h]) {
        this.candidates[h] = new DrawnHand(this.plan.hands[h], 0.45);
        this.stage.scene.add(this.candidates[h].group);
      }
      this.candidates[h].pose(poseAt(r.pose, 7 * i), r.joints[i], 0, new Set(this.plan.hands[h].links.keys()));
    }
    this.applyLayers();
  }

  /** Numbers on the target's surface; -1: none. */
  chooseMap(i) {
    this.shownMap = i;
    this.mapSelect.value = i;
    for (const button of document.querySelectorAll(".map-choice"))
      button.classList.toggle("chosen", Number(button.dataset.map) === i);
    if (this.mapDiscs) dispose(this.mapDiscs);
    this.mapDiscs = null;
    this.legendHolder.replaceChildren();
    const map = this.plan.maps[i];
    if (!this.stage.isDrawing) return;
    this.bodies[this.plan.map_body].object.material.color.setHex(map ? kMapped : kObject);
    if (!map) return this.stage.ask();
    const point = unpack(map.point), normal = unpack(map.normal), value = unpack(map.value);
    const low = value.reduce((a, b) => Math.min(a, b), Infinity),
          high = value.reduce((a, b) => Math.max(a, b), -Infinity);
    const span = high > low ? high - low : 1;
    this.mapDiscs =
        discs(point, normal, 0.66 * typicalSpacing(point, normal), (k) => scaleColour((value[k] - low) / span));
    this.stage.scene.add(this.mapDiscs);
    this.legendHolder.append(legend(map.label, quantity(low, map.unit), quantity(high, map.unit)));
    this.applyLayers();
  }

  applyLayers() {
    if (!this.stage?.isDrawing || !this.bodies) return;
    const {layers} = this;
    for (const body of this.bodies) {
      body.object.visible =
          !body.isGone && (body.role === "obstacle" ? layers.obstacles : body.role === "object" || layers.robot);
    }
    const target = this.bodies[this.plan.map_body];
    if (this.mapDiscs) {
      this.mapDiscs.matrix.copy(target.object.matrix);
      this.mapDiscs.visible = target.object.visible;
    }
    this.candidates.forEach((candidate, h) => {
      // Before anything moves: later the target is elsewhere.
      if (candidate)
        candidate.group.visible =
            layers.candidate && this.shown >= 0 && this.ranking.hand[this.shown] === h && this.now === 0;
    });
    this.stage.ask();
  }

  frameAll() {
    if (!this.stage.isDrawing) return;
    const box = boxOf(this.bodies.filter((body) => body.role !== "obstacle").map((body) => body.object));
    this.stage.azimuth = -0.65;
    this.stage.elevation = 0.42;
    this.stage.frame(box);
  }

  frameTarget() {
    if (!this.stage.isDrawing) return;
    const box = boxOf([this.bodies[this.plan.map_body].object]);
    this.stage.frame(box.expandByScalar(0.3 * box.getSize(new THREE.Vector3()).length()));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, textarea")) return;
    const seeks = {ArrowLeft: this.now - 0.1, ArrowRight: this.now + 0.1, Home: 0, End: this.duration};
    const rows = {ArrowUp: -1, ArrowDown: 1};
    if (event.key in seeks) {
      this.play(false);
      this.seek(seeks[event.key]);
    } else if (event.key in rows && this.order.length) {
      const at = this.order.indexOf(this.shown);
      this.choose(this.order[Math.min(this.order.length - 1, Math.max(0, at + rows[event.key]))]);
    } else if (event.key === " " && !event.target.matches("button")) {
      this.play(!this.isPlaying);
    } else if (event.key.toLowerCase() === "f") {
      this.frameAll();
    } else if (event.key.toLowerCase() === "g") {
      this.frameTarget();
    } else {
      return;
    }
    event.preventDefault();
  }

  close() {
    this.play(false);
    document.removeEventListener("keydown", this.onKey);
    this.stage.close();
  }
}
