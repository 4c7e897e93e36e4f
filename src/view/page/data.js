// What the program put into the page, and how it is shown: packed arrays, elements, numbers.

const kArrays = {
  f4: Float32Array,
  u4: Uint32Array,
  u2: Uint16Array,
  u1: Uint8Array
};

/** The data of a name: a JSON block of the page, null when there is none. */
function readBlock(name) {
  const element = document.getElementById(name);
  return element ? JSON.parse(element.textContent) : null;
}

/** The numbers of a packed text "TYPE:BASE64". */
function unpack(text) {
  const bytes = atob(text.slice(3));
  const raw = new Uint8Array(bytes.length);
  for (let i = 0; i < raw.length; ++i) raw[i] = bytes.charCodeAt(i);
  return new kArrays[text.slice(0, 2)](raw.buffer);
}

/** element("p", {class: "note", onclick: f}, "text", child): an HTML element. */
function element(tag, attributes = {}, ...children) {
  return fillElement(document.createElement(tag), attributes, children);
}

/** The same for SVG. */
function drawn(tag, attributes = {}, ...children) {
  return fillElement(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function fillElement(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on"))
      node.addEventListener(name.slice(2), value);
    else if (value === true)
      node.setAttribute(name, "");
    else if (value !== false && value !== undefined)
      node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined && child !== ""));
  return node;
}

/** 1234567 as "1,234,567". */
function count(n) {
  return Math.round(n).toLocaleString("en-US");
}

/** A number with four significant digits, its unit behind it; what is not known says so. */
function quantity(value, unit = "") {
  if (Number.isNaN(value) || value === null || value === undefined) return "not known";
  if (!Number.isFinite(value)) return "unbounded";
  const text = value === 0 ? "0" : Math.abs(value) >= 1000 ? count(value) : Number(value.toPrecision(4)).toString();
  return unit ? text + "\u00a0" + unit : text;
}

/** A share as a percentage with a useful number of digits. */
function percent(part, all) {
  if (!(all > 0)) return "-";
  const p = 100 * part / all;
  return (p === 0 || p >= 99.95 ? p.toFixed(0) : p >= 0.1 ? p.toFixed(1) : "< 0.1") + "\u00a0%";
}

function seconds(s) {
  if (s < 0.001) return (s * 1e6).toFixed(0) + "\u00a0\u00b5s";
  if (s < 1) return (s * 1e3).toFixed(s < 0.1 ? 1 : 0) + "\u00a0ms";
  if (s < 120) return s.toFixed(s < 10 ? 2 : 1) + "\u00a0s";
  return s < 7200 ? (s / 60).toFixed(1) + "\u00a0min" : (s / 3600).toFixed(1) + "\u00a0h";
}

/** snake_case as words. */
function words(name) {
  return name.replace(/_/g, " ");
}

/** A table of two columns: [[label, text or element], ...]. */
function factTable(facts) {
  return element(
      "table", {class: "facts"},
      element(
          "tbody", {},
          ...facts.map(
              ([label, value]) => element("tr", {}, element("th", {scope: "row"}, label), element("td", {}, value)))));
}

/** A switch with a label: changes `state[key]`. */
function toggle(label, state, key, changed, title) {
  const input = element("input", {
    type: "checkbox",
    onchange: () => {
      state[key] = input.checked;
      changed();
    }
  });
  input.checked = state[key];
  input.dataset.key = key;
  return element("label", {class: "toggle", title}, input, element("span", {}, label));
}

/** Pose [x, y, z, qx, qy, qz, qw] at an offset of an array. */
function poseAt(array, offset = 0) {
  const [x, y, z, a, b, c, d] = array.slice(offset, offset + 7);
  return new THREE.Matrix4().compose(
      new THREE.Vector3(x, y, z), new THREE.Quaternion(a, b, c, d).normalize(), new THREE.Vector3(1, 1, 1));
}

/**
 * Pose of every link in the root link: X = X_parent X_PJ M(q), M a turn about the joint's axis or a shift along it.
 * @param hand   links (parents first) and joints, as the program wrote them
 * @param q      joint positions, `offset` where they begin
 */
function linkPoses(hand, q, offset = 0) {
  const poses = [];
  for (const link of hand.links) {
    let pose = poseAt(link.pose);
    if (link.joint >= 0) {
      const joint = hand.joints[link.joint], axis = new THREE.Vector3(...joint.axis), position = q[offset + link.joint];
      const motion = joint.prismatic ? new THREE.Matrix4().makeTranslation(...axis.multiplyScalar(position).toArray()) :
                                       new THREE.Matrix4().makeRotationAxis(axis, position);
      pose = poseAt(joint.pose).multiply(motion);
    }
    poses.push(link.parent >= 0 ? pose.premultiply(poses[link.parent]) : pose);
  }
  return poses;
}
