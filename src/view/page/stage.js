// The 3-D view: a scene with z up, a camera that turns about a point, and what is drawn in it.

const kFieldOfView = 28;  // degrees, vertical: little perspective, as in the pictures of `handhold render`
const kCrease = 0.77;     // cosine: faces that meet at less than 40 degrees are shaded as one smooth surface

/** A geometry with three corners a triangle, their normals the area-weighted mean over the smooth surface around. */
function smoothGeometry(vertices, triangles) {
  const n = triangles.length / 3;
  const position = new Float32Array(9 * n), area = new Float32Array(3 * n), normal = new Float32Array(9 * n);
  for (let i = 0; i < triangles.length; ++i) {
    for (let k = 0; k < 3; ++k) position[3 * i + k] = vertices[3 * triangles[i] + k];
  }
  const begin = new Uint32Array(vertices.length / 3 + 1);  // of each vertex in `around`
  for (const v of triangles) ++begin[v + 1];
  for (let v = 0; v + 1 < begin.length; ++v) begin[v + 1] += begin[v];
  const around = new Uint32Array(triangles.length), next = begin.slice();
  for (let i = 0; i < triangles.length; ++i) around[next[triangles[i]]++] = Math.floor(i / 3);
  const length = new Float32Array(n);
  for (let t = 0; t < n; ++t) {
    const p = position.subarray(9 * t, 9 * t + 9);
    const ux = p[3] - p[0], uy = p[4] - p[1], uz = p[5] - p[2], vx = p[6] - p[0], vy = p[7] - p[1], vz = p[8] - p[2];
    area[3 * t] = uy * vz - uz * vy;
    area[3 * t + 1] = uz * vx - ux * vz;
    area[3 * t + 2] = ux * vy - uy * vx;
    length[t] = Math.hypot(area[3 * t], area[3 * t + 1], area[3 * t + 2]) || 1e-30;
  }
  for (let i = 0; i < triangles.length; ++i) {
    const t = Math.floor(i / 3), v = triangles[i];
    let x = 0, y = 0, z = 0;
    for (let k = begin[v]; k < begin[v + 1]; ++k) {
      const o = around[k];
      const dot = area[3 * t] * area[3 * o] + area[3 * t + 1] * area[3 * o + 1] + area[3 * t + 2] * area[3 * o + 2];
      if (dot < kCrease * length[t] * length[o]) continue;
      x += area[3 * o], y += area[3 * o + 1], z += area[3 * o + 2];
    }
    const size = Math.hypot(x, y, z) || 1;
    normal[3 * i] = x / size, normal[3 * i + 1] = y / size, normal[3 * i + 2] = z / size;
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
  return geometry;
}

/** A mesh block of the page as an object to draw; its pose is its matrix. */
function solid(mesh, colour, options = {}) {
  const material = new THREE.MeshPhongMaterial(
      {color: colour, specular: 0x161616, shininess: 20, side: THREE.DoubleSide, ...options});
  const object = new THREE.Mesh(smoothGeometry(unpack(mesh.vertices), unpack(mesh.triangles)), material);
  object.matrixAutoUpdate = false;
  return object;
}

/** Of surfaces in one plane, the one with the lower number is in front everywhere, not here one and there the other. */
function behind(number) {
  return {polygonOffset: true, polygonOffsetFactor: 0.02 * number, polygonOffsetUnits: 4 * number};
}

/** Frees what the graphics card holds of an object and all below it. */
function dispose(object) {
  object.traverse((part) => {
    if (part.geometry) part.geometry.dispose();
    if (part.material) part.material.dispose();
  });
  if (object.parent) object.parent.remove(object);
}

/** A disc at each point, lying on the surface. @param colourOf  (i) => [r, g, b] */
function discs(points, normals, radius, colourOf) {
  const n = points.length / 3, kSides = n > 5000 ? 7 : 12;
  const position = new Float32Array(n * (kSides + 1) * 3), colour = new Float32Array(n * (kSides + 1) * 3);
  const index = new Uint32Array(n * kSides * 3), z = new THREE.Vector3(), x = new THREE.Vector3(),
        y = new THREE.Vector3();
  for (let i = 0; i < n; ++i) {
    z.set(normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
    x.set(Math.abs(z.x) < 0.7 ? 1 : 0, Math.abs(z.x) < 0.7 ? 0 : 1, 0).cross(z).normalize();
    y.crossVectors(z, x);
    const rgb = colourOf(i), first = i * (kSides + 1);
    for (let s = 0; s <= kSides; ++s) {
      const r = s === kSides ? 0 : radius, angle = 2 * Math.PI * s / kSides;
      const c = r * Math.cos(angle), d = r * Math.sin(angle), lift = 0.12 * radius;
      const k = 3 * (first + s);
      position[k] = points[3 * i] + c * x.x + d * y.x + lift * z.x;
      position[k + 1] = points[3 * i + 1] + c * x.y + d * y.y + lift * z.y;
      position[k + 2] = points[3 * i + 2] + c * x.z + d * y.z + lift * z.z;
      colour.set(rgb, k);
      if (s < kSides) index.set([first + kSides, first + s, first + (s + 1) % kSides], 3 * (i * kSides + s));
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  const material = new THREE.MeshBasicMaterial({vertexColors: THREE.VertexColors, side: THREE.FrontSide});
  const object = new THREE.Mesh(geometry, material);
  object.matrixAutoUpdate = false;
  object.facesOfADisc = kSides;
  return object;
}

/** Which disc a face belongs to. */
function discOf(object, face) {
  return Math.floor(face / object.facesOfADisc);
}

/** The middle of the distances between a few points and their nearest neighbours on the same side of the surface. */
function typicalSpacing(points, normals) {
  const n = points.length / 3, probes = Math.min(n, 40), nearest = [];
  for (let k = 0; k < probes; ++k) {
    const i = 3 * Math.floor(k * n / probes);
    let least = Infinity;
    for (let j = 0; j < 3 * n; j += 3) {
      const facing = normals[i] * normals[j] + normals[i + 1] * normals[j + 1] + normals[i + 2] * normals[j + 2];
      if (j !== i && facing > 0.7)
        least = Math.min(
            least, Math.hypot(points[j] - points[i], points[j + 1] - points[i + 1], points[j + 2] - points[i + 2]));
    }
    if (least > 0 && least < Infinity) nearest.push(least);
  }
  nearest.sort((a, b) => a - b);
  return nearest.length ? nearest[Math.floor(nearest.length / 2)] : 0.005;
}

/** The camera looks at `target` from a direction and distance; dragging turns it, z stays up. */
class Stage {
  /** @param holder  element that the canvas fills  @param label  says what is seen, for those who do not see it */
  constructor(holder, label) {
    this.holder = holder;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(kFieldOfView, 1, 0.001, 100);
    this.camera.up.set(0, 0, 1);
    this.target = new THREE.Vector3();
    this.azimuth = -0.9;
    this.elevation = 0.45;
    this.distance = 1;
    this.light = new THREE.DirectionalLight(0xffffff, 0.52);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xa09a94, 0.74), this.light, this.light.target);
    this.isAsked = false;
    try {
      this.renderer = new THREE.WebGLRenderer({antialias: true, alpha: true});
    } catch (error) {
      holder.append(element(
          "p", {class: "empty"}, "This browser offers no WebGL, so nothing is drawn here. The numbers are complete."));
      return;
    }
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.canvas = this.renderer.domElement;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    holder.prepend(this.canvas);
    this.compass = drawn("svg", {class: "compass", viewBox: "-40 -40 80 80", "aria-hidden": "true"});
    this.ruler = element("div", {class: "ruler"});
    holder.append(element("div", {class: "orientation"}, this.compass, this.ruler));
    new ResizeObserver(() => this.resize()).observe(holder);
    this.listen();
    this.resize();
  }

  get isDrawing() {
    return this.renderer !== undefined;
  }

  /** Unit vector from the target to the camera. */
  get toEye() {
    const c = Math.cos(this.elevation);
    return new THREE.Vector3(c * Math.cos(this.azimuth), c * Math.sin(this.azimuth), Math.sin(this.elevation));
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.holder;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  /** Draws before the next frame, once however often it is asked. */
  ask() {
    if (this.isAsked || !this.isDrawing) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.draw();
    });
  }

  draw() {
    const eye = this.toEye.multiplyScalar(this.distance).add(this.target);
    this.camera.position.copy(eye);
    this.camera.lookAt(this.target);
    this.camera.near = this.distance / 100;
    this.camera.far = this.distance * 50;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    // From above the left shoulder.
    const left = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0).multiplyScalar(-0.5);
    this.light.position.copy(this.target).add(this.toEye).add(left).add(new THREE.Vector3(0, 0, 0.9));
    this.light.target.position.copy(this.target);
    this.renderer.render(this.scene, this.camera);
    this.drawCompass();
    this.drawRuler();
  }

  drawCompass() {
    const inverse = this.camera.matrixWorldInverse, parts = [];
    for (const [i, name] of ["x", "y", "z"].entries()) {
      const v = new THREE.Vector3().setComponent(i, 1).transformDirection(inverse);
      parts.push({
        depth: v.z,
        node: drawn(
            "g", {class: "axis-" + name}, drawn("line", {x1: 0, y1: 0, x2: 24 * v.x, y2: -24 * v.y}),
            drawn("text", {x: 33 * v.x, y: -33 * v.y + 4, "text-anchor": "middle"}, name))
      });
    }
    parts.sort((a, b) => a.depth - b.depth);
    this.compass.replaceChildren(...parts.map((part) => part.node));
  }

  /** A length at the depth of the target, for scale. */
  drawRuler() {
    const pixels = this.holder.clientHeight / (2 * this.distance * Math.tan(kFieldOfView * Math.PI / 360));  // a metre
    const wanted = 90 / pixels, power = 10 ** Math.floor(Math.log10(wanted));
    const length = [5, 2, 1].map((f) => f * power).find((l) => l <= wanted);
    const text = length >= 1 ? `${length} m` :
        length >= 0.1 ? `${Math.round(100 * length)} cm` :
                        `${Number((1000 * length).toPrecision(1))} mm`;
    this.ruler.style.width = (length * pixels).toFixed(1) + "px";
    this.ruler.textContent = text;
  }

  /** Puts the camera where a box of the world is seen whole, from the direction it has. */
  frame(box) {
    if (box.isEmpty()) return;
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    this.target.copy(sphere.center);
    const vertical = kFieldOfView * Math.PI / 360, horizontal = Math.atan(Math.tan(vertical) * this.camera.aspect);
    this.distance = 1.04 * Math.max(sphere.radius, 1e-3) / Math.sin(Math.min(vertical, horizontal));
    this.ask();
  }

  turn(dx, dy) {
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.min(1.55, Math.max(-1.55, this.elevation + 0.008 * dy));
    this.ask();
  }

  shift(dx, dy) {
    const scale = 2 * this.distance * Math.tan(kFieldOfView * Math.PI / 360) / this.holder.clientHeight;
    const x = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
    const y = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1);
    this.target.addScaledVector(x, -dx * scale).addScaledVector(y, dy * scale);
    this.ask();
  }

  zoom(factor) {
    this.distance = Math.min(50, Math.max(0.01, this.distance * factor));
    this.ask();
  }

  /** One pointer turns, with Shift or the right button it shifts; two pinch and shift; the wheel zooms. */
  listen() {
    const pointers = new Map();
    let travelled = 0;  // px, since a pointer came down: a click does not travel
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
      travelled = 0;
    });
    this.canvas.addEventListener("click", (event) => {
      if (travelled > 4 || !this.onClick) return;
      const box = this.canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
      ray.setFromCamera(
          {x: 2 * (event.clientX - box.left) / box.width - 1, y: 1 - 2 * (event.clientY - box.top) / box.height},
          this.camera);
      this.onClick(ray);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    this.canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
      travelled += Math.hypot(dx, dy);
      if (pointers.size === 2) {
        const other = [...pointers.values()].find((p) => p.pointerId !== event.pointerId);
        const span = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
        this.zoom(Math.max(1, span(before)) / Math.max(1, span(event)));
        this.shift(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 2) {
        this.shift(dx, dy);
      } else {
        this.turn(dx, dy);
      }
      pointers.set(event.pointerId, event);
    });
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0012 * event.deltaY * (event.deltaMode === 1 ? 30 : 1)));
    }, {passive: false});
  }

  close() {
    if (!this.isDrawing) return;
    dispose(this.scene);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/** The box around objects that are drawn. */
function boxOf(objects) {
  const box = new THREE.Box3();
  for (const object of objects) {
    object.updateMatrixWorld(true);
    object.traverse((part) => {
      if (!part.geometry || part.geometry.attributes.position.count === 0) return;
      if (!part.geometry.boundingBox) part.geometry.computeBoundingBox();
      box.union(part.geometry.boundingBox.clone().applyMatrix4(part.matrixWorld));
    });
  }
  return box;
}

/** A hand that can be put anywhere: its links as the page stores them. */
class DrawnHand {
  constructor(hand, opacity = 1) {
    this.hand = hand;
    this.group = new THREE.Group();
    this.group.matrixAutoUpdate = false;
    const options = opacity < 1 ? {transparent: true, opacity, depthWrite: false} : {};
    this.links = hand.links.map((link, i) => {
      const part = solid(link.mesh, kLink, {...options, ...behind(i)});
      part.visible = part.geometry.attributes.position.count > 0;
      this.group.add(part);
      return part;
    });
    this.palm = hand.links.findIndex((link) => unpack(link.mesh.triangles).length > 0);
  }

  /** @param touching  set of link numbers that are in contact */
  pose(X_WH, q, offset, touching) {
    this.group.matrix.copy(X_WH);
    linkPoses(this.hand, q, offset).forEach((X_HL, i) => {
      this.links[i].matrix.copy(X_HL);
      this.links[i].material.color.setHex(i === this.palm ? kPalm : touching.has(i) ? kTouching : kLink);
    });
    this.group.updateMatrixWorld(true);
  }
}
