// The data of the page, and their texts. The address of the page names the chosen tag: #tag=28.
export const element = id => document.getElementById(id);
export const data = JSON.parse(element('data').textContent);
export const state = { sensor: 0, clock: 'wall' };  // the sensor of the map, and the clock of the charts
data.tags.forEach((tag, number) => { tag.number = number; });
for (const { extremes, unit } of data.sensors) {
  for (const extreme of extremes) extreme[0] = extreme[0].replace(` ${unit}`, `\u00a0${unit}`);  // on one line
}

export const SECOND_MS = 1000, MINUTE_MS = 60 * SECOND_MS, HOUR_MS = 60 * MINUTE_MS;
export const DAY_SECONDS = 86400, DAY_MS = DAY_SECONDS * SECOND_MS;
export const NO_ROOM = 'of the numbers have no room: choose a tag to see its own';

export const placed_tags = data.tags.filter(tag => tag.x !== null);
export const tags_in_table = data.tags.filter(tag => tag.has_failed || tag.outcome === 'read');
// If all failures have the same word, the key shows it, and not each tag.
export const failure_words = [...new Set(data.tags.filter(tag => tag.has_failed).map(tag => tag.outcome))];
export const is_extreme = (sensor, tag) => sensor?.extremes.some(([, ids]) => ids.includes(tag.id));
export const address = id => `#tag=${encodeURIComponent(id)}`;

// Numbers, times and names as texts

export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
export const short = (number, digits) => String(Number(number.toPrecision(digits)));
const pad = number => String(number).padStart(2, '0');
export const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
export const short_zone = ms =>
  new Date(ms).toLocaleTimeString('en-GB', { timeZoneName: 'short' }).split(' ').at(-1);
export const clock = ms => new Date(ms).toTimeString().slice(0, 'HH:MM:SS'.length);
export const date = ms =>
  new Date(ms).toLocaleDateString('en-GB', { day: 'numeric', month: 'short', year: 'numeric' });
export const day_time = seconds =>
  `${pad(Math.floor(seconds / 3600) % 24)}:${pad(Math.floor(seconds / 60) % 60)}`;
export const is_one_day = new Set(data.span_ms.map(date)).size <= 1;
export const with_unit = (sensor, value) => `${value.toFixed(sensor.decimals)}\u00a0${sensor.unit}`.trim();
// Returns the names of the sensors that a failed tag has.
const list = new Intl.ListFormat('en-GB');
export const lost_of = tag =>
  list.format(data.sensors.filter(sensor => sensor.failed[tag.number]).map(sensor => sensor.name));

export const facts_of = tag => [
  `tag ${tag.id}: ${tag.outcome}${tag.reason ? ` (${tag.reason})` : ''}`,
  ...tag.values.map((value, n) => value === null ? '' : `${data.sensors[n].name} ${with_unit(data.sensors[n], value)}`),
  tag.stamp_ms === null ? '' : `${clock(tag.stamp_ms)} (greenhouse ${day_time(tag.time_of_day)})`,
  tag.attempts > data.fewest_attempts ? `${tag.attempts} attempts` : '',
].filter(Boolean);

// Scales

// Returns the smallest of 1, 2, 5, 10, 20, 50 and so on that is not below `least`.
export function nice_step(least) {
  const power = 10 ** Math.floor(Math.log10(least)), rounding = 0.999;
  return [1, 2, 5, 10].map(digit => digit * power).find(step => step >= least * rounding);
}

// Returns the multiples of a step from low to high.
export function ticks_of(low, high, step) {
  const rounding = 1e-9;
  const first = Math.ceil(low / step - rounding), count = Math.floor(high / step + rounding) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, n) => (first + n) * step);
}
