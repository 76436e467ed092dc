/**
 * AP, ML and SI of both trunk points over the last seconds, below each other, each about its
 * reference, with the interval in which it lies at 95 % as a shade (not of SI, of which none is
 * sent). Where a point was not measured, its line has a gap and the strip is grey.
 */

import { font, pen } from "./canvas.js";
import { Reach } from "./scale.js";
import { AXES, POINTS } from "./samples.js";

/** How much is shown. */
export const SPAN_S = 20;

/** Half of an interval at 95 %, in standard deviations. */
const SD = 1.96;
const LEFT_PX = 64;
const BOTTOM_PX = 22;
/** Below this, mm, a movement is noise. */
const REACH_MM_MIN = 1;

/** @typedef {import("./samples.js").Samples} Samples */

/** @param {Samples} samples */
export function strips(samples) {
  const reaches = AXES.map(() => new Reach(REACH_MM_MIN));
  /** @type {(context: CanvasRenderingContext2D, width: number, height: number, colours: Record<string, string>) => void} */
  return (context, width, height, colours) => {
    const start_ms = samples.newest_ms - 1000 * SPAN_S;
    const from = samples.since(start_ms);
    const right = width - 8;
    const x = (/** @type {number} */ time_ms) => right - ((samples.newest_ms - time_ms) / (1000 * SPAN_S)) * (right - LEFT_PX);
    const strip_px = (height - BOTTOM_PX) / AXES.length;
    const gaps = find_gaps(samples, from, start_ms);
    const origins = { lower: samples.origin("lower", from), upper: samples.origin("upper", from) };
    AXES.forEach((name, axis) => {
      const top = axis * strip_px;
      const half_mm = reaches[axis].fit(samples.furthest([axis], from, origins));
      const y = (/** @type {number} */ mm) => top + strip_px / 2 - (mm / half_mm) * (strip_px / 2 - 6);
      context.fillStyle = colours.gap;
      context.globalAlpha = 0.5;
      for (const [gap_ms, end_ms] of gaps) {
        context.fillRect(x(gap_ms), top + 3, Math.max(1.5, x(end_ms) - x(gap_ms)), strip_px - 6);
      }
      context.globalAlpha = 1;
      frame(context, name, half_mm, y, right, top, strip_px, colours);
      for (const point of POINTS) {
        const origin = origins[point];
        if (origin) line(context, samples, point, axis, from, origin[axis], x, y, colours[point]);
      }
    });
    times(context, right, height, colours);
  };
}

/** The times, ms, in which a point or a whole frame is missing. */
function find_gaps(samples, from, start_ms) {
  const gaps = [];
  const apart_ms = samples.gap_ms();
  let before_ms = Math.max(start_ms, samples.at_ms(from));
  for (let place = from; place < samples.count; place += 1) {
    const now_ms = samples.at_ms(place);
    const is_missing = POINTS.some((point) => samples.is_missing(point, place));
    if (is_missing || now_ms - before_ms > apart_ms) {
      const last = gaps.at(-1);
      if (last && last[1] === before_ms) last[1] = now_ms;
      else gaps.push([before_ms, now_ms]);
    }
    before_ms = now_ms;
  }
  return gaps;
}

function frame(context, name, half_mm, y, right, top, strip_px, colours) {
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.beginPath();
  for (const mm of [-half_mm, 0, half_mm]) {
    context.moveTo(LEFT_PX, Math.round(y(mm)) + 0.5);
    context.lineTo(right, Math.round(y(mm)) + 0.5);
  }
  context.stroke();
  context.fillStyle = colours.ink;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.font = `650 ${font(15)}`;
  context.fillText(name, 2, top + strip_px / 2);
  context.font = font(11);
  context.fillStyle = colours.soft;
  context.textAlign = "right";
  context.fillText(`+${half_mm}`, LEFT_PX - 6, y(half_mm) + 4);
  context.fillText(`−${half_mm}`, LEFT_PX - 6, y(-half_mm) - 4);
}

function line(context, samples, point, axis, from, origin, x, y, colour) {
  context.fillStyle = colour;
  context.strokeStyle = colour;
  context.lineWidth = 1.6;
  context.lineJoin = "round";
  const gap_ms = samples.gap_ms();
  const goes_on = (/** @type {number} */ place) =>
    place < samples.count && !samples.is_missing(point, place) && samples.at_ms(place) - samples.at_ms(place - 1) < gap_ms;
  for (let first = from; first < samples.count; first += 1) {
    if (samples.is_missing(point, first)) continue;
    let end = first + 1;
    while (goes_on(end)) end += 1;
    const mm = (/** @type {number} */ place) => samples.value(point, axis, place) - origin;
    if (axis < 2) shade(context, samples, point, axis, first, end, mm, x, y);
    context.beginPath();
    const drawn = pen(context);
    drawn.move(x(samples.at_ms(first)), y(mm(first)));
    for (let place = first + 1; place < end; place += 1) drawn.line(x(samples.at_ms(place)), y(mm(place)));
    context.stroke();
    first = end - 1;
  }
}

/** The interval at 95 % along a piece of a line. */
function shade(context, samples, point, axis, first, end, mm, x, y) {
  const { move, line } = pen(context);
  const edge = (/** @type {number} */ place, /** @type {number} */ sign) =>
    /** @type {const} */ ([x(samples.at_ms(place)), y(mm(place) + sign * SD * samples.sd(point, axis, place))]);
  context.globalAlpha = 0.22;
  context.beginPath();
  move(...edge(first, 1));
  for (let place = first; place < end; place += 1) line(...edge(place, 1));
  for (let place = end - 1; place >= first; place -= 1) line(...edge(place, -1));
  context.fill();
  context.globalAlpha = 1;
}

function times(context, right, height, colours) {
  context.fillStyle = colours.soft;
  context.font = font(12);
  context.textBaseline = "bottom";
  for (let ago_s = 0; ago_s <= SPAN_S; ago_s += 5) {
    context.textAlign = ago_s === 0 ? "right" : "center";
    const at = right - (ago_s / SPAN_S) * (right - LEFT_PX);
    context.fillText(ago_s === 0 ? "now" : `−${ago_s} s`, at, height - 2);
  }
}
