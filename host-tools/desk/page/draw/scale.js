/** Scales that change seldom, so that a movement does not look larger or smaller from moment to moment. */

const STEPS = [1, 2, 5];

/** The least of 1, 2, 5, 10, 20 … times `least` that is not below `value`. @param {number} value @param {number} least */
export function step_up(value, least) {
  for (let power = least; ; power *= 10) {
    const found = STEPS.map((step) => step * power).find((step) => step >= value);
    if (found !== undefined || power > 1e6) return found ?? power;
  }
}

/** Half the height of a drawing, mm, which grows at once and shrinks only when it is far too large. */
export class Reach {
  /** @param {number} least_mm */
  constructor(least_mm) {
    this.least_mm = least_mm;
    this.mm = least_mm;
  }

  /** @param {number} furthest_mm What must fit. */
  fit(furthest_mm) {
    const wanted = step_up(furthest_mm * 1.1, this.least_mm);
    if (wanted > this.mm || wanted * 2.5 <= this.mm) this.mm = wanted;
    return this.mm;
  }
}
