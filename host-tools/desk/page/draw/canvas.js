/** What every drawing needs: a canvas as fine as the screen, the page's colours, and a time to draw. */

/** Colours by the names of the style sheet's variables. @typedef {Record<string, string>} Colours */

const NAMES = ["paper", "ink", "soft", "line", "edge", "panel", "lower", "upper", "gap", "accent", "good", "warn", "bad"];

/** @type {Colours | undefined} */
let colours;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (colours = undefined));

/** The colours that the style sheet has at present. @returns {Colours} */
export function page_colours() {
  if (!colours) {
    const style = getComputedStyle(document.documentElement);
    colours = Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return colours;
}

let kept = 0;

/** How many drawings are kept up to date. */
export const drawings = () => kept;

/**
 * Calls `draw` once per picture of the display for as long as the canvas is on the page, if
 * `version` has changed, or the size, or the colours.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {() => unknown} version
 * @param {(context: CanvasRenderingContext2D, width: number, height: number, colours: Colours) => void} draw
 *   In CSS pixels.
 * @returns {() => void} Ends it.
 */
export function keep_drawn(canvas, version, draw) {
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  let drawn = {};
  let request = 0;
  const frame = () => {
    request = requestAnimationFrame(frame);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const now = { version: version(), width, height, ratio: devicePixelRatio, colours: page_colours() };
    if (!width || !height || Object.entries(now).every(([name, value]) => drawn[name] === value)) return;
    drawn = now;
    const [across, down] = [width, height].map((length) => Math.round(length * devicePixelRatio));
    if (canvas.width !== across || canvas.height !== down) Object.assign(canvas, { width: across, height: down });
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, width, height);
    draw(context, width, height, now.colours);
  };
  request = requestAnimationFrame(frame);
  kept += 1;
  return () => {
    kept -= 1;
    cancelAnimationFrame(request);
  };
}

/** A line's points are left out when they are closer to the one before than this: nobody sees them. */
const LEAST_PX = 0.7;

/**
 * Draws a line through many points, at the cost of those that can be seen.
 *
 * @param {CanvasRenderingContext2D} context
 */
export function pen(context) {
  let [last_x, last_y] = [NaN, NaN];
  const to = (/** @type {"moveTo" | "lineTo"} */ draw, /** @type {number} */ x, /** @type {number} */ y) => {
    [last_x, last_y] = [x, y];
    context[draw](x, y);
  };
  return {
    move: (/** @type {number} */ x, /** @type {number} */ y) => to("moveTo", x, y),
    line(/** @type {number} */ x, /** @type {number} */ y) {
      if (Math.abs(x - last_x) > LEAST_PX || Math.abs(y - last_y) > LEAST_PX) to("lineTo", x, y);
    },
  };
}

/** The font of letters in drawings. @param {number} px */
export const font = (px) => `${px}px system-ui, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif`;
