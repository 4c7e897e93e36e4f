// Opens reports as a person does: a headless Chromium, from the file system, without a network.
// Usage: node report_test.mjs HANDHOLD HANDHOLD_PLAN REPEAT_GRASPS FOLDER_OF_PACKAGES
import assert from "node:assert/strict";
import {execFileSync} from "node:child_process";
import fs from "node:fs";
import {createRequire} from "node:module";
import os from "node:os";
import path from "node:path";
import {fileURLToPath, pathToFileURL} from "node:url";

const source = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
const [handhold, handholdPlan, repeatGrasps, packages] =
    process.argv.slice(2).map((argument) => path.resolve(argument));
const {chromium} = createRequire(path.join(packages, "package.json"))("playwright-core");
const folder = fs.mkdtempSync(path.join(os.tmpdir(), "handhold_browser_"));
const db = path.join(folder, "db");
const kLargeSet = 20000;
const kLoadLimit = 6000;      // ms: twice what a large set may take on a machine that does nothing else
const kPoseTolerance = 1e-5;  // m: the page has 32-bit floats

const run = (program, ...parameters) =>
    execFileSync(program, parameters, {encoding: "utf8", stdio: ["ignore", "pipe", "pipe"], maxBuffer: 1 << 28});
const query = (...parameters) => JSON.parse(
    run(handhold, "query", "--db", db, "--object", "mug", "--hand", "barrett", "--format", "json", ...parameters));
const inFolder = (name) => path.join(folder, name);

function makeInputs() {
  fs.writeFileSync(
      inFolder("job.yaml"),
      `catalog: [{name: mug, mesh: ${source}/meshes/mug.obj, unit: m}]\nhands: [${source}/hands/barrett]\n` +
          "sampling: {samples: 60, rolls: 8}\nquality: {load_margin: {grasps: 20}}\n");
  run(handhold, "build", inFolder("job.yaml"), "--db", db, "--progress", "none");
  run(repeatGrasps, path.join(db, "mug/barrett/v0001.h5"), "0", db);
  run(repeatGrasps, path.join(db, "mug/barrett/v0001.h5"), String(kLargeSet), inFolder("large_db"));
  run(handhold, "report", "--db", db, "--out", inFolder("all.html"));
  run(handhold, "report", "--db", db, "--object", "mug", "--out", inFolder("mug.html"));
  run(handhold, "report", "--db", db, "--object", "mug_repeated", "--out", inFolder("none.html"));
  run(handhold, "report", "--db", inFolder("large_db"), "--out", inFolder("large.html"));
  run(handholdPlan, "plan", "--robot", `${source}/robots/puma560`, "--scene", `${source}/jobs/scenes/clutter_puma.yaml`,
      "--db", db, "--out", inFolder("plan.json"));
  run(handholdPlan, "report", inFolder("plan.json"), "--out", inFolder("plan.html"));
}

/** A page whose every complaint, and every request but for its own file, fails the test. */
async function open(browser, file, options = {}, before = () => {}) {
  const context =
      await browser.newContext({viewport: {width: 1100, height: 640}, colorScheme: "light", offline: true, ...options});
  const page = await context.newPage();
  await page.addInitScript(before);
  page.complaints = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) page.complaints.push(message.text());
  });
  page.on("pageerror", (error) => page.complaints.push(String(error)));
  page.on("request", (request) => {
    if (!/^(file|data):/.test(request.url())) page.complaints.push("asks for " + request.url());
  });
  const start = Date.now();
  await page.goto(pathToFileURL(inFolder(file)).href);
  await page.waitForSelector("html[data-ready]");
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  page.loadMs = Date.now() - start;
  return page;
}

async function close(page) {
  assert.deepEqual(page.complaints, []);
  await page.context().close();
}

/** What the 3-D view shows: its number of colours and a sum that changes with the picture. */
const picture = (page) => page.evaluate(() => {
  const {stage} = handhold.view, copy = document.createElement("canvas");
  copy.width = 320, copy.height = 240;
  stage.draw();
  const context = copy.getContext("2d");
  context.drawImage(stage.canvas, 0, 0, 320, 240);
  const pixels = new Uint32Array(context.getImageData(0, 0, 320, 240).data.buffer);
  return {colours: new Set(pixels).size, sum: pixels.reduce((sum, pixel, i) => (sum * 31 + pixel + i) >>> 0, 7)};
});
const text = (page, selector) => page.locator(selector).first().innerText();
const passing = (page) => page.evaluate(() => Array.from(handhold.view.order));
const setRange = (page, key, which, thousandth) => page.evaluate(([k, w, value]) => {
  const histogram = handhold.view.histograms.find((h) => h.column.key === k), input = histogram[w];
  input.value = value;
  input.dispatchEvent(new Event("input"));
  return w === "from" ? histogram.least : histogram.largest;
}, [key, which, thousandth]);
const isWithinWidth = (page) => page.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth);

/** Pose of every node of a .glb file in its scene, as [x, y, z] of the node's origin and of its point (1, 0, 0). */
function glbNodes(file) {
  const bytes = fs.readFileSync(file), json = JSON.parse(bytes.subarray(20, 20 + bytes.readUInt32LE(12)).toString());
  const rotate = ([x, y, z, w], v) => {
    const t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
    return [
      v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
      v[2] + w * t[2] + x * t[1] - y * t[0]
    ];
  };
  const found = {};
  const visit = (index, place) => {
    const node = json.nodes[index],
          to = (v) =>
              place(rotate(node.rotation ?? [0, 0, 0, 1], v).map((x, i) => x + (node.translation ?? [0, 0, 0])[i]));
    found[node.name] = {origin: to([0, 0, 0]), x: to([1, 0, 0])};
    for (const child of node.children ?? []) visit(child, to);
  };
  for (const index of json.scenes[0].nodes) visit(index, (v) => v);
  return found;
}

async function testGraspSet(browser) {
  const page = await open(browser, "mug.html");
  await checkBrowsing(page);
  await checkPoses(page);
  await checkFilters(page);
  await close(page);
}

async function checkBrowsing(page) {
  const all = query();
  assert.match(await page.title(), /mug x barrett/);
  assert.equal(await text(page, ".navigator output"), `1 of ${all.length}`);
  assert.match(await text(page, ".details"), new RegExp(Number(all[0].epsilon.toPrecision(4))));
  const first = await picture(page);
  assert.ok(first.colours > 300, `only ${first.colours} colours`);
  await page.keyboard.press("ArrowRight");
  assert.equal(await text(page, ".navigator output"), `2 of ${all.length}`);
  assert.notEqual((await picture(page)).sum, first.sum, "another grasp, the same picture");
  await page.keyboard.press("End");
  assert.equal(await page.evaluate(() => handhold.view.shown), all.length - 1);
  await page.keyboard.press("PageUp");
  assert.equal(await page.evaluate(() => handhold.view.shown), all.length - 11);
  await page.keyboard.press("Home");
  await page.locator(".list-rows .list-row").nth(4).click();
  assert.match(await text(page, ".details h2"), /^Grasp 4/);
  assert.match(page.url(), /#set-\d+:4$/);
  const before = (await picture(page)).sum;
  await page.locator(".canvas canvas").hover();
  await page.mouse.down();
  await page.mouse.move(480, 260);
  await page.mouse.up();
  assert.notEqual((await picture(page)).sum, before, "dragging turns nothing");
  let last = (await picture(page)).sum;
  for (const key of "hsca") {
    await page.keyboard.press(key);
    const {sum} = await picture(page);
    assert.notEqual(sum, last, `key ${key} changes nothing`);
    last = sum;
  }
  // A click on a surface sample shows the best grasp from there.
  const [x, y, wanted] = await page.evaluate(() => {
    const {view} = handhold, {stage, samples, grasps} = view, box = stage.canvas.getBoundingClientRect();
    const wanted = Array.from(view.order).find((i) => {  // one that faces the camera
      const n = samples.normal.slice(3 * grasps.trial[3 * i], 3 * grasps.trial[3 * i] + 3);
      return stage.toEye.dot(new THREE.Vector3(...n)) > 0.8;
    });
    const sample = grasps.trial[3 * wanted],
          p = new THREE.Vector3(...samples.point.slice(3 * sample, 3 * sample + 3)).project(stage.camera);
    if (!view.layers.samples) document.querySelector("input[data-key=samples]").click();
    return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height, wanted];
  });
  await page.mouse.click(x, y);
  assert.equal(await page.evaluate(() => handhold.view.shown), wanted, "the sample that was clicked");
  await page.keyboard.press("?");
  assert.ok(await page.locator("dialog.help").isVisible());
  await page.keyboard.press("Escape");
  for (const id of ["outcomes", "times", "provenance"]) assert.ok((await text(page, "#" + id)).length > 40, id);
  assert.match(await text(page, "#provenance"), new RegExp(path.basename(folder)));
}

/** The links stand where the glTF export, which another path of the program writes, has them. */
async function checkPoses(page) {
  run(handhold, "export", "--to", "gltf", "--db", db, "--object", "mug", "--hand", "barrett", "--top", "3", "--out",
      inFolder("glb"));
  for (let i = 0; i < 3; ++i) {
    const nodes = glbNodes(path.join(inFolder("glb"), `mug_barrett_${i}.glb`));
    const links = await page.evaluate((grasp) => {
      const {view} = handhold;
      view.show(grasp);
      view.stage.draw();
      return view.hand.links.map((link, l) => {
        const X = view.drawnHand.links[l].matrixWorld;
        return {
          name: link.name,
          origin: new THREE.Vector3().applyMatrix4(X).toArray(),
          x: new THREE.Vector3(1, 0, 0).applyMatrix4(X).toArray()
        };
      });
    }, i);
    assert.ok(links.length > 5);
    for (const link of links) {
      for (const key of ["origin", "x"]) {
        const distance = Math.hypot(...link[key].map((x, k) => x - nodes[link.name][key][k]));
        assert.ok(distance < kPoseTolerance, `grasp ${i}: ${key} of ${link.name} is ${distance} m off`);
      }
    }
  }
}

/** Every filter leaves what `handhold query` finds. */
async function checkFilters(page) {
  const all = query().length;
  const same = async (what, ...parameters) => {
    const wanted = query(...parameters).map((grasp) => grasp.grasp);
    assert.ok(wanted.length > 0 && wanted.length < all, `${what}: ${wanted.length} of ${all} is no test`);
    assert.deepEqual(await passing(page), wanted, what);
    assert.match(await text(page, ".passed"), new RegExp(`^${wanted.length.toLocaleString("en-US")} of `));
  };
  const epsilon = await setRange(page, "epsilon", "from", 400);
  await same("epsilon", "--min-epsilon", String(epsilon));
  await page.keyboard.press("r");
  assert.equal((await passing(page)).length, all);
  const friction = await setRange(page, "critical_friction", "to", 500);
  await same("critical friction", "--friction", String(friction));
  await page.keyboard.press("r");
  await page.selectOption("select[aria-label='approach direction']", "-z");
  await same("approach", "--approach", "0,0,-1", "--within", "45");
  await page.keyboard.press("r");
  const [, ...others] = await page.evaluate(
      () => handhold.view.chips.map((chip) => chip.input.checked && handhold.view.set.preshapes[chip.i]));
  for (const name of others) await page.locator(".chip", {hasText: name}).last().click();
  await same("preshape", "--preshape", await page.evaluate(() => handhold.view.set.preshapes[0]));
  for (const box of await page.locator(".chip input:checked").all()) await box.uncheck();
  assert.deepEqual(await passing(page), []);
  assert.match(await text(page, ".details"), /No grasp/);
  await page.keyboard.press("r");
  const margins = query().map((grasp) => grasp.load_margin).filter((margin) => margin !== null).length;
  await setRange(page, "load_margin", "from", 1);
  assert.ok((await passing(page)).length < margins, "grasps without a load margin pass a filter of it");
}

async function testLooks(browser) {
  const page = await open(browser, "mug.html", {colorScheme: "dark"});
  assert.equal(await page.getAttribute("html", "data-theme"), "dark");
  await page.keyboard.press("t");
  assert.equal(await page.getAttribute("html", "data-theme"), "light");
  const luminance =
      await page.evaluate(() => Array.from({length: 65}, (_, i) => handhold.scaleColour(i / 64)).map(([r, g, b]) => {
        const linear = (x) => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
        return 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
      }));
  for (let i = 1; i < luminance.length; ++i)
    assert.ok(luminance[i] > luminance[i - 1], `the scale does not get lighter at ${i}`);
  await page.setViewportSize({width: 390, height: 800});
  assert.ok(await isWithinWidth(page), "390 pixels are too narrow");
  await close(page);
  const flat = await open(browser, "mug.html", {}, () => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  assert.match(await text(flat, ".canvas"), /no WebGL/);
  const isOnTop = await flat.evaluate(() => {
    const note = document.querySelector(".canvas > .empty"), box = note.getBoundingClientRect();
    return note.contains(document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2));
  });
  assert.ok(isOnTop, "the note that there is no WebGL lies below something");
  await flat.keyboard.press("ArrowRight");
  assert.match(await text(flat, ".details h2"), /^Grasp 1/, "without WebGL the numbers are missing");
  assert.ok(flat.complaints.every((complaint) => /WebGL/.test(complaint)), String(flat.complaints));
  await flat.context().close();
  const empty = await open(browser, "none.html");
  assert.match(await text(empty, ".view .empty"), /no force-closed grasp/);
  assert.ok((await picture(empty)).colours > 50, "the object of a set without grasps is not drawn");
  await close(empty);
}

async function testOverview(browser) {
  const page = await open(browser, "all.html");
  assert.equal(await page.locator("table.sets tbody tr").count(), 2);
  assert.equal(await page.locator("table.sets img").count(), 1, "of sets with a grasp");
  assert.ok(await page.locator("table.sets img")
                .first()
                .evaluate((image) => image.decode().then(() => image.naturalWidth === 264)));
  const objects = () => page.locator("table.sets tbody td:nth-child(2)").allInnerTexts();
  await page.getByRole("button", {name: "Grasps"}).click();
  assert.deepEqual(await objects(), ["mug", "mug_repeated"], "the most grasps first");
  await page.getByRole("button", {name: "Grasps"}).click();
  assert.deepEqual(await objects(), ["mug_repeated", "mug"], "the fewest first");
  await page.fill("input[type=search]", "REPEAT");
  assert.deepEqual(await objects(), ["mug_repeated"]);
  await page.fill("input[type=search]", "teapot");
  assert.match(await text(page, ".overview .empty"), /teapot/);
  await page.fill("input[type=search]", "barrett");
  await page.getByRole("link", {name: "mug", exact: true}).click();
  await page.waitForSelector(".workbench");
  assert.ok((await picture(page)).colours > 300);
  await page.getByRole("link", {name: "All sets"}).click();
  await page.waitForSelector("table.sets");
  assert.ok(await isWithinWidth(page));
  await close(page);
}

async function testPlan(browser) {
  const page = await open(browser, "plan.html"), plan = JSON.parse(fs.readFileSync(inFolder("plan.json"), "utf8"));
  const points = plan.trajectory.points, duration = points[points.length - 1].time_from_start;
  assert.equal(await text(page, ".status"), "planned");
  assert.match(await text(page, ".details h2"), new RegExp(`^Grasp ${plan.grasp}`));
  const counts = await page.evaluate(
      () => handhold.view.ranking.verdict.reduce((all, v) => ({...all, [v]: (all[v] ?? 0) + 1}), {}));
  for (const [reason, n] of Object.entries(plan.rejected)) assert.equal(counts[reason], n, reason);
  assert.ok(plan.tested > 1, "no grasp is rejected in this scene");
  assert.equal(counts.planned, 1);
  const start = await picture(page);
  assert.ok(start.colours > 300);
  const sums = new Set();
  for (let i = -1; i < 5; ++i) {
    await page.evaluate((map) => handhold.view.chooseMap(map), i);
    sums.add((await picture(page)).sum);
  }
  assert.equal(sums.size, 6, "distance map, four scores and none do not all look different");
  await page.keyboard.press(" ");
  await page.waitForFunction(() => handhold.view.now > 0.2);
  await page.keyboard.press(" ");
  const stopped = await page.evaluate(() => handhold.view.now);
  assert.ok(stopped < duration);
  assert.notEqual((await picture(page)).sum, start.sum, "the robot does not move");
  await page.keyboard.press("End");
  const [rise, offset] = await page.evaluate(() => {
    const {view} = handhold, height = () => view.bodies[0].object.matrix.elements[14], end = height();
    view.seek(0);
    return [end - height(), view.duration];
  });
  assert.ok(Math.abs(rise - 0.05) < 1e-4, `the object rises by ${rise} m, want the lift of 0.05 m`);
  assert.ok(Math.abs(offset - duration) < 1e-3);
  await page.locator(".list-rows .list-row").first().click();
  assert.ok(await isWithinWidth(page));
  await page.setViewportSize({width: 390, height: 800});
  assert.ok(await isWithinWidth(page), "390 pixels are too narrow");
  await close(page);
}

async function testLargeSet(browser) {
  const page = await open(browser, "large.html");
  assert.match(await text(page, ".navigator output"), /of 20,000$/);
  assert.ok((await picture(page)).colours > 300);
  const ms = await page.evaluate(() => {
    const time = (f, times) => {
      const start = performance.now();
      for (let i = 0; i < times; ++i) f(i);
      return (performance.now() - start) / times;
    };
    const {view} = handhold, gl = view.stage.renderer.getContext(), pixel = new Uint8Array(4);
    const drawWhole = () => {
      view.stage.draw();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    };  // waits
    return {
      turn: time(
          () => {
            view.stage.turn(20, 3);
            drawWhole();
          },
          10),
      show: time((i) => view.show(1000 * i), 10),
      filter: time(
          () => {
            view.histograms[0].from.value = 300;
            view.filtersChanged();
          },
          5)
    };
  });
  assert.ok((await passing(page)).length < kLargeSet);
  const size = fs.statSync(inFolder("large.html")).size / 1e6;
  console.log(
      `large set: ${kLargeSet} grasps, ${size.toFixed(1)} MB, loaded and drawn after ${page.loadMs} ms; ` +
      `turn ${ms.turn.toFixed(1)} ms, next grasp ${ms.show.toFixed(1)} ms, filter ${
          ms.filter.toFixed(1)} ms (no graphics card)`);
  assert.ok(page.loadMs < kLoadLimit, `loading took ${page.loadMs} ms`);
  await close(page);
}

const kTests = {
  testGraspSet,
  testLooks,
  testOverview,
  testPlan,
  testLargeSet
};
let failed = 0, browser;
try {
  const start = Date.now();
  makeInputs();
  console.log(`inputs: ${Date.now() - start} ms`);
  browser = await chromium.launch({
    executablePath: "/usr/bin/chromium",
    headless: true,
    args: ["--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
  });
  for (const [name, test] of Object.entries(kTests)) {
    const begin = Date.now();
    try {
      await test(browser);
      console.log(`${name}: passed, ${Date.now() - begin} ms`);
    } catch (error) {
      ++failed;
      console.log(`${name}: FAILED\n${error.stack}`);
    }
    for (const context of browser.contexts()) await context.close();  // of a test that failed
  }
} finally {
  await browser?.close();
  fs.rmSync(folder, {recursive: true});
}
process.exit(failed ? 1 : 0);
