/**
 * The transverse plane, as seen from above: forward is up, the person's right is right. Each trunk
 * point's path of the last seconds about its reference, the older the fainter; where it is now, with
 * the region in which it lies at 95 % as a shade.
 */

import { font, pen } from "./canvas.js";
import { Reach } from "./scale.js";
import { POINTS } from "./samples.js";

/** How long a path is. */
export const TAIL_S = 20;

/** The shades from new to old. */
const SHADES = 5;

/** Half the axes of the region that holds a normal variable of two dimensions at 95 %, in standard deviations. */
const ELLIPSE_SD = Math.sqrt(5.991);

/** Below this, mm, a path is noise. */
const REACH_MM_MIN = 1;

/** @typedef {import("./samples.js").Samples} Samples */

/** @param {Samples} samples */
export function plane(samples) {
  const reach = new Reach(REACH_MM_MIN);
  /** @type {(context: CanvasRenderingContext2D, width: number, height: number, colours: Record<string, string>) => void} */
  return (context, width, height, colours) => {
    const from = samples.since(samples.newest_ms - 1000 * TAIL_S);
    const origins = { lower: samples.origin("lower", from), upper: samples.origin("upper", from) };
    const half_mm = reach.fit(samples.furthest([0, 1], from, origins));
    const px_per_mm = Math.min(width, height) / 2 / half_mm;
    const x = (/** @type {number} */ ml) => width / 2 + ml * px_per_mm;
    const y = (/** @type {number} */ ap) => height / 2 - ap * px_per_mm;
    rings(context, width, height, half_mm, px_per_mm, colours);
    for (const point of POINTS) {
      const origin = origins[point];
      if (!origin) continue;
      path(context, samples, point, from, origin, x, y, colours[point]);
      place(context, samples, point, origin, x, y, px_per_mm, colours);
    }
  };
}

function rings(context, width, height, half_mm, px_per_mm, colours) {
  const [centre_x, centre_y] = [width / 2, height / 2];
  context.strokeStyle = colours.line;
  context.fillStyle = colours.soft;
  context.lineWidth = 1;
  context.font = font(12);
  context.beginPath();
  context.moveTo(centre_x, 0);
  context.lineTo(centre_x, height);
  context.moveTo(0, centre_y);
  context.lineTo(width, centre_y);
  context.stroke();
  for (const part of [0.5, 1]) {
    context.beginPath();
    context.arc(centre_x, centre_y, part * half_mm * px_per_mm - 0.5, 0, 2 * Math.PI);
    context.stroke();
  }
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(`${half_mm / 2} mm`, centre_x + (half_mm / 2) * px_per_mm * 0.707 + 5, centre_y - (half_mm / 2) * px_per_mm * 0.707);
  context.textBaseline = "top";
  context.fillText("forward", centre_x + 5, 4);
  context.textAlign = "right";
  context.textBaseline = "bottom";
  context.fillText("right", width - 4, centre_y - 3);
}

function path(context, samples, point, from, origin, x, y, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 1.6;
  context.lineJoin = "round";
  const gap_ms = samples.gap_ms();
  const { move, line } = pen(context);
  /** @type {(place: number) => [number, number]} */
  const at = (place) => [x(samples.value(point, 1, place) - origin[1]), y(samples.value(point, 0, place) - origin[0])];
  let place = from;
  for (let shade = SHADES; shade > 0; shade -= 1) {
    // From old to new: the newest part lies above the others.
    const until_ms = samples.newest_ms - ((shade - 1) / SHADES) * TAIL_S * 1000;
    context.globalAlpha = 1 - (shade - 1) * (0.8 / SHADES);
    context.beginPath();
    let pen_is_down = false;
    for (; place < samples.count; place += 1) {
      const follows = pen_is_down && samples.at_ms(place) - samples.at_ms(place - 1) < gap_ms;
      pen_is_down = !samples.is_missing(point, place);
      if (pen_is_down && follows) line(...at(place));
      else if (pen_is_down) move(...at(place));
      if (samples.at_ms(place) >= until_ms) break;
    }
    context.stroke();
  }
  context.globalAlpha = 1;
}

/** Where a point is now. */
function place(context, samples, point, origin, x, y, px_per_mm, colours) {
  const newest = samples.count - 1;
  if (samples.is_missing(point, newest)) return;
  const [at_x, at_y] = [x(samples.value(point, 1, newest) - origin[1]), y(samples.value(point, 0, newest) - origin[0])];
  const [long, short, turn] = ellipse(samples.covariance(point, newest));
  context.fillStyle = colours[point];
  if (long > 0) {
    context.globalAlpha = 0.3;
    context.beginPath();
    context.ellipse(at_x, at_y, long * px_per_mm, short * px_per_mm, turn, 0, 2 * Math.PI);
    context.fill();
    context.globalAlpha = 1;
  }
  context.strokeStyle = colours.paper;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(at_x, at_y, 5, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
}

/**
 * The half axes, mm, and the turn of the long one on the screen, radians, of the region at 95 %.
 *
 * @param {ArrayLike<number>} covariance_mm2 Of AP and AP, AP and ML, ML and ML.
 */
export function ellipse({ 0: ap, 1: both, 2: ml }) {
  if (!(ap >= 0 && ml >= 0)) return [0, 0, 0];
  const [mean, difference] = [(ap + ml) / 2, (ml - ap) / 2];
  const root = Math.hypot(difference, both);
  const axes = [mean + root, mean - root].map((it) => ELLIPSE_SD * Math.sqrt(Math.max(0, it)));
  // On the screen AP points up, that is towards negative y.
  return [...axes, -Math.atan2(2 * both, ml - ap) / 2];
}
