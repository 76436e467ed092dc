/** Numbers in words, and words as numbers. */

/** @param {number | null | undefined} value @param {number} digits @param {string} unit */
export function number(value, digits = 0, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return unit ? `${value.toFixed(digits)} ${unit}` : value.toFixed(digits);
}

/**
 * A number that was typed, with a point or a comma; `null` where nothing was. What is not a number stays a
 * text, which the desk refuses: `NaN` would reach it as if nothing had been typed.
 *
 * @param {unknown} text
 * @returns {number | string | null}
 */
export function number_or_text(text) {
  const typed = String(text ?? "").trim();
  if (typed === "") return null;
  const value = Number(typed.replace(",", "."));
  return Number.isFinite(value) ? value : typed;
}

/** The same; what is not a number is an error in words. @param {unknown} text @param {string} label What the field is called. */
export function typed_number(text, label) {
  const value = number_or_text(text);
  if (typeof value === "string") throw new Error(`${label}: “${value}” is not a number – type one such as 12.5`);
  return value;
}

/** The same where there must be one. @param {unknown} text @param {string} label */
export function needed_number(text, label) {
  const value = typed_number(text, label);
  if (value === null) throw new Error(`${label}: nothing is typed – type a number such as 12.5`);
  return value;
}

/** A duration as minutes and seconds. @param {number} seconds */
export function clock(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** @param {number} count @param {string} one @param {string} [many] */
export const counted = (count, one, many = `${one}s`) => `${count} ${count === 1 ? one : many}`;

/** A time of day by this computer's clock. @param {string} utc As RFC 3339 writes it. */
export function time_of_day(utc) {
  const time = new Date(utc);
  if (Number.isNaN(time.getTime())) return utc;
  const two = (/** @type {number} */ it) => String(it).padStart(2, "0");
  const day = [time.getFullYear(), two(time.getMonth() + 1), two(time.getDate())].join("-");
  return `${day} ${two(time.getHours())}:${two(time.getMinutes())}`;
}
