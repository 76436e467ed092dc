/**
 * The latest positions of both trunk points, in buffers of a fixed size: the oldest make room.
 *
 * Every position is in millimetres in the scene's axes: AP forward, ML to the person's right, SI up.
 * What was not measured is NaN. Nothing here is smoothed or filled in. A frame that comes late is put
 * where it belongs in time.
 */

/** What is kept: a minute at 200 Hz. */
export const CAPACITY = 12_288;

/** A frame that is later than so many others is left out: only drawings miss it. */
const LATE_MAX = 2_000;

/** @typedef {"lower" | "upper"} Point */
/** @type {Point[]} */
export const POINTS = ["lower", "upper"];

/** The axes, in the order in which a position lists them. */
export const AXES = ["AP", "ML", "SI"];

/** Three coordinates, and three entries of the covariance in the transverse plane: AP AP, AP ML, ML ML. */
const STRIDE = 6;

/** How many of the latest distances between frames tell the usual one. */
const USUAL_OF = 31;

/** Two frames further apart than this many times the usual distance have a gap between them. */
const GAP_FRAMES = 1.6;

/** @typedef {import("../desk/wire.js").FrameRow} FrameRow */
/** @typedef {import("../desk/wire.js").Reference} Reference */

export class Samples {
  constructor(capacity = CAPACITY) {
    this.capacity = capacity;
    this.time_ms = new Float64Array(capacity);
    /** @type {Record<Point, Float32Array>} */
    this.values = { lower: new Float32Array(capacity * STRIDE), upper: new Float32Array(capacity * STRIDE) };
    /** Changes whenever a drawing must be made anew. */
    this.version = 0;
    /** How many have ever come; the newest in time has the place `count - 1`. */
    this.count = 0;
    /** The number, by the desk, of the latest that came. @type {number | null} */
    this.latest = null;
    /** @type {Reference} */
    this.reference = { number: 0, upper: null, lower: null };
  }

  clear() {
    this.count = 0;
    this.latest = null;
    this.reference = { number: 0, upper: null, lower: null };
    this.version += 1;
  }

  /** @param {FrameRow[]} frames @param {Reference} reference */
  add(frames, reference) {
    for (const frame of frames) this.#put(frame);
    this.reference = reference;
    this.version += 1;
  }

  /** @param {FrameRow} frame */
  #put(frame) {
    this.latest = Math.max(this.latest ?? 0, frame.number);
    let place = this.count;
    if (!(frame.at_ms >= this.newest_ms) && this.count > 0) {
      place = this.since(frame.at_ms);
      if (this.count - place > LATE_MAX || (place === this.oldest && this.count >= this.capacity)) return;
    }
    for (let later = this.count; later > place; later -= 1) this.#move(later - 1, later);
    this.count += 1;
    const at = place % this.capacity;
    this.time_ms[at] = frame.at_ms;
    for (const point of POINTS) {
      const row = frame[point];
      const values = row ? [...row.p, ...row.c] : new Array(STRIDE).fill(NaN);
      this.values[point].set(values, at * STRIDE);
    }
  }

  /** @param {number} from @param {number} to */
  #move(from, to) {
    const [source, target] = [from % this.capacity, to % this.capacity];
    this.time_ms[target] = this.time_ms[source];
    for (const point of POINTS) {
      this.values[point].copyWithin(target * STRIDE, source * STRIDE, (source + 1) * STRIDE);
    }
  }

  /** The place of the oldest that is kept. */
  get oldest() {
    return Math.max(0, this.count - this.capacity);
  }

  /** The time of the newest, ms of the desk's clock, or NaN. @returns {number} */
  get newest_ms() {
    return this.count ? this.at_ms(this.count - 1) : NaN;
  }

  /** @param {number} place */
  at_ms(place) {
    return this.time_ms[place % this.capacity];
  }

  /** The place of the first that is not older than this. @param {number} from_ms */
  since(from_ms) {
    let [low, high] = [this.oldest, this.count];
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.at_ms(middle) < from_ms) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** A coordinate, mm. @param {Point} point @param {number} axis @param {number} place */
  value(point, axis, place) {
    return this.values[point][(place % this.capacity) * STRIDE + axis];
  }

  /** @param {Point} point @param {number} place */
  is_missing(point, place) {
    return Number.isNaN(this.value(point, 0, place));
  }

  /** The variance of AP, the covariance of AP and ML, the variance of ML, mm². @param {Point} point @param {number} place */
  covariance(point, place) {
    const from = (place % this.capacity) * STRIDE + AXES.length;
    return this.values[point].subarray(from, from + 3);
  }

  /** The standard deviation, mm; NaN of SI, which is not sent. @param {Point} point @param {number} axis @param {number} place */
  sd(point, axis, place) {
    return axis < 2 ? Math.sqrt(this.values[point][(place % this.capacity) * STRIDE + AXES.length + 2 * axis]) : NaN;
  }

  /** How far two frames that follow each other usually are apart, ms. */
  usual_ms() {
    const first = Math.max(this.oldest + 1, this.count - USUAL_OF);
    const apart = [];
    for (let place = first; place < this.count; place += 1) apart.push(this.at_ms(place) - this.at_ms(place - 1));
    apart.sort((one, other) => one - other);
    return apart.length ? apart[Math.floor(apart.length / 2)] : Infinity;
  }

  /** Frames further apart have others missing between them, ms. */
  gap_ms() {
    return GAP_FRAMES * this.usual_ms();
  }

  /**
   * From where movement is drawn: the desk's reference, and the mean of what is shown where it has none.
   *
   * @param {Point} point @param {number} from The place from which on it is shown.
   * @returns {ArrayLike<number> | null}
   */
  origin(point, from) {
    const reference = this.reference[point];
    if (reference) return reference;
    const sums = [0, 0, 0];
    let seen = 0;
    for (let place = from; place < this.count; place += 1) {
      if (this.is_missing(point, place)) continue;
      seen += 1;
      AXES.forEach((_, axis) => (sums[axis] += this.value(point, axis, place)));
    }
    return seen ? sums.map((sum) => sum / seen) : null;
  }

  /**
   * The largest distance from the origins along some axes, mm.
   *
   * @param {number[]} axes @param {number} from @param {Record<Point, ArrayLike<number> | null>} origins
   */
  furthest(axes, from, origins) {
    let most = 0;
    for (const point of POINTS) {
      const origin = origins[point];
      if (!origin) continue;
      for (let place = from; place < this.count; place += 1) {
        for (const axis of axes) {
          const away = Math.abs(this.value(point, axis, place) - origin[axis]);
          // NaN is not larger.
          if (away > most) most = away;
        }
      }
    }
    return most;
  }
}
