// Colours of values. The scale is a path through OKLCH (B. Ottosson, "A perceptual color space for image processing",
// 2020): lightness rises evenly, so that order is seen without colour vision and in grey; hue goes from blue by green
// to yellow, whose ends people who confuse red and green tell apart.

function fromOklch(L, C, hue) {
  const a = C * Math.cos(hue), b = C * Math.sin(hue);
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.2914855480 * b) ** 3;
  const linear = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s, -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s
  ];
  return linear.map((x) => {
    const c = Math.min(1, Math.max(0, x));
    return c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055;
  });
}

/** Red, green and blue (0 to 1) of a value from 0 to 1. */
function scaleColour(t) {
  const u = Math.min(1, Math.max(0, t));
  const hue = 275 - 170 * u ** 1.1;
  return fromOklch(0.34 + 0.58 * u, 0.105 + 0.04 * u * u, hue * Math.PI / 180);
}

function css(rgb) {
  return "#" + rgb.map((x) => Math.round(255 * x).toString(16).padStart(2, "0")).join("");
}

const kNoValue = [0.62, 0.62, 0.64];  // where there is none

// What is drawn. The same as in the pictures of `handhold render`.
const kObject = 0xe09a55, kPalm = 0x4d5a6b, kLink = 0x99a1ab, kTouching = 0x4a7fc1, kContact = 0xd4152f;
const kRobot = 0xa6adb7, kObstacle = 0x7f8995, kMapped = 0xc9cdd2;

/** The legend of the scale: a strip with its ends and a label. */
function legend(label, low, high, note) {
  const stops = Array.from({length: 17}, (_, i) => css(scaleColour(i / 16)));
  return element(
      "div", {class: "legend"}, element("div", {class: "legend-label"}, label),
      element("div", {class: "strip", style: `background: linear-gradient(to right, ${stops.join(", ")})`}),
      element("div", {class: "legend-ends"}, element("span", {}, low), element("span", {}, high)),
      note ? element("div", {class: "legend-note"}, element("i", {style: `background: ${css(kNoValue)}`}), note) :
             null);
}
