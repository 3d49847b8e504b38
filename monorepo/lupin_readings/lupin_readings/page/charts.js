// The charts: one for each sensor, with a line for each tag, over wall time or the time of day in the greenhouse.
import {
  clamp, clock, data, date, DAY_MS, DAY_SECONDS, day_time, element, HOUR_MS, is_extreme, MINUTE_MS, nice_step, NO_ROOM,
  SECOND_MS, state, ticks_of, with_unit,
} from './data.js';
import { HALF_TEXT, mark, nearest, path_of, size_of, start_drawing, width_of, write } from './drawing.js';
import { around, draw_leader, label_dot, plan_labels, TEXT_HEIGHT, write_in } from './labels.js';
import { choose, show_chosen } from './choice.js';

const LONG_LINE = 40;  // points, from which a chart is as wide as the page
const MOST_LABELLED = 100;  // lines of a chart; of more, only the chosen one has a label
const ONE_MOMENT_MS = SECOND_MS;  // readings within this time have no chart
const SMALLEST_SIDE = 120;  // of a chart
const ABOVE = 8, BELOW = 26;  // the lines, of which the latter has the times
const FROM_EDGE = 10, LEFT_OF_CHART = 6, ABOVE_EDGE = 8;  // of the numbers of the axes
const TICK = 5, HALF_TICK = 3;
const VALUE_TICKS = 7, VALUE_ROOM = 0.08, SMALLEST_ROOM = 1e-6;  // at both ends of the values, as shares
const TIME_ROOM = 0.01, SMALLEST_WALL_ROOM_MS = 250, SMALLEST_DAY_ROOM_MS = 5 * MINUTE_MS;
const WALL_STEP = 64, DAY_STEP = 40;  // at least, between two times
const WALL_STEPS_MS = [
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, DAY_SECONDS,
].map(seconds => seconds * SECOND_MS);
const LONGEST_GAP = 8;  // in usual distances of the points of a line; a longer one has no line
const MOST_DOTTED = 30;  // points of a line, each of which has a dot
const DOT = 3, BESIDE_DOT = 3, APART = 7;  // radius, and between points at one time, so that none covers another
const FARTHEST_POINT = 40;  // from the pointer
const LINE_STEP = 11;  // between the labels at the ends of the lines
const LABEL_GAP = 14, NARROWEST_LABEL = 14, WIDEST_LABEL = 80, LABEL_SPACE = 6;  // of these labels
const BESIDE_LONE = 22;  // at both ends of a chart of points without a line, room for their labels
const FROM_AXIS = 6, BEYOND_LINE = 6, POINT_WIDTH = 6;  // of the labels of such points
const LONE_RADIUS = 2, BOLD_RADIUS = 4, LONE_SPACE = 3;

export const is_line = data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > 1));
export const is_long = data.sensors.length === 1
  || data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > LONG_LINE));
export const has_charts = data.sensors.length > 0 && data.span_ms[1] - data.span_ms[0] > ONE_MOMENT_MS;

export function draw_charts(is_again = false) {
  element('figures').replaceChildren();
  const figures = data.sensors.filter(sensor => sensor.lines.length).map(sensor => {
    const figure = mark(element('figures'), 'figure'), caption = mark(figure, 'figcaption');
    mark(caption, 'b', {}, sensor.label);
    return [sensor, mark(figure, 'div', { class: 'charting' }), mark(caption, 'span')];
  });
  // The heading is the first of the cells if they would not fill the last row.
  const columns = getComputedStyle(element('charts')).gridTemplateColumns.split(' ').length;
  element('charts').classList.toggle('first', figures.length % columns > 0);
  // Measured after all figures exist, which changes their sizes. All charts have the same time axis.
  const charts = figures.map(([sensor, place, readout]) => {
    const size = size_of(place).map(side => Math.max(Math.floor(side), SMALLEST_SIDE));
    return { sensor, place, readout, size, values: value_axis(sensor), labels: column_of(sensor, size[1]) };
  });
  const numbers = charts.flatMap(({ values }) => values.ticks.map(value => width_of(values.text(value))));
  const left = FROM_EDGE + Math.max(...numbers), beside = Math.max(...charts.map(({ labels }) => labels.width));
  for (const chart of charts) draw_chart(chart, left, chart.size[0] - beside);
  const { offsetHeight } = element('lines');
  element('series').textContent = legend();
  if (element('lines').offsetHeight !== offsetHeight && !is_again) draw_charts(true);  // in the room that is left
  show_chosen();
}

// Returns what the charts show.
function legend() {
  const line = `${is_line ? 'line' : 'point'} is a tag with its number`, value = is_line ? 'last value' : 'value';
  const is_moved = document.querySelector('.beside'), unlabelled = document.querySelectorAll('.series .spare').length;
  return [
    `Each ${line}`,
    ...is_moved ? ['a point that would cover another is moved to the right'] : [],
    ...document.querySelector('.marked') ? [`bold: the lowest and the highest ${value}`] : [],
    ...unlabelled ? [`${unlabelled} ${NO_ROOM}`] : [],
  ].join('; ') + '.';
}

function draw_chart({ sensor, place, readout, size: [width, height], values, labels }, left, right) {
  const times = time_axis(right - left), start = left + (labels.count ? 0 : BESIDE_LONE);
  const x = at => start + (at - times.low) / (times.high - times.low) * (right - start);
  const y = value => ABOVE + (values.top - value) / (values.top - values.bottom) * (height - ABOVE - BELOW);
  const axis_name = state.clock === 'wall' ? 'wall time' : 'time of day in the greenhouse';
  const name = `${sensor.label} of ${sensor.lines.length} tags against ${axis_name}`;
  const svg = start_drawing(place, width, height, { role: 'img', 'aria-label': name });
  for (const value of values.ticks) {
    mark(svg, 'path', { class: 'grid', d: `M${left} ${y(value)}H${right}` });
    write(svg, left - LEFT_OF_CHART, y(value) + HALF_TEXT, values.text(value), 'end');
  }
  const tick = (at, length) => mark(svg, 'path', { class: 'tick', d: `M${x(at)} ${y(values.bottom)}v${length}` });
  for (const at of times.halves) tick(at, HALF_TICK);
  for (const at of times.ticks) {
    tick(at, TICK);
    const text = times.text(at);
    write(svg, Math.min(x(at), width - width_of(text) / 2), height - ABOVE_EDGE, text, 'middle');
  }
  const lines = sensor.lines.map(line => {
    const tag = data.tags[line.tag], points = points_of(line, tag, times, x, y);
    return { tag, points, text: end_text(sensor, tag), is_bold: is_marked(sensor, tag) };
  });
  if (move_apart(lines)) svg.classList.add('beside');
  for (const line of lines) line.group = draw_line(svg, line);
  lines.sort((one, other) => other.is_bold - one.is_bold);  // which have labels first
  const ends = label_ends(lines.filter(line => line.points.length > 1), labels, right + LABEL_GAP);
  const room = [left + FROM_AXIS, 0, labels.count ? right + BEYOND_LINE : width, y(values.bottom)];
  label_points(lines, room, ends);
  const points = lines.flatMap(line => line.points), point_at = event => nearest(points, svg, event, FARTHEST_POINT);
  place.addEventListener('pointermove', event => { readout.textContent = readout_of(sensor, point_at(event)); });
  place.addEventListener('pointerleave', () => { readout.textContent = ''; });
  place.addEventListener('click', event => choose(point_at(event)?.tag));
}

// Returns the points of a line, in the order of their times.
function points_of(line, tag, times, x, y) {
  return line[state.clock].map(([offset, value, low = value, high = value]) => {
    const at = times.ms_of(offset);
    return { tag, at, value, low, high, x: x(at), y: y(value), y_low: y(low), y_high: y(high) };
  }).sort((one, other) => one.at - other.at);
}

// Moves each lone point of a tag beside one that it would cover; returns whether any was moved.
function move_apart(lines) {
  const placed = [];
  for (const point of lines.filter(({ points }) => points.length === 1).map(({ points }) => points[0])) {
    const other = placed.findLast(p => Math.abs(p.from - point.x) < BESIDE_DOT && Math.abs(p.y - point.y) < APART);
    point.from = point.x;
    if (other) point.x = other.x + APART;
    placed.push(point);
  }
  return placed.some(point => point.x !== point.from);
}

// The text at the end of a line: of the lowest and the highest value, with this value.
const is_marked = (sensor, tag) => sensor.extremes.length > 1 && is_extreme(sensor, tag);
const end_text = (sensor, tag) =>
  is_marked(sensor, tag) ? `${tag.id}: ${tag.values[data.sensors.indexOf(sensor)].toFixed(sensor.decimals)}` : tag.id;

function draw_line(svg, { tag, points, is_bold }) {
  const group = mark(svg, 'g', { class: is_bold ? 'series marked' : 'series', 'data-tag': tag.id });
  const runs = runs_of(points).filter(run => run.length > 1);
  for (const run of runs.filter(points => points.some(p => p.low < p.high))) {
    const band = [...run.map(p => [p.x, p.y_high]), ...run.map(p => [p.x, p.y_low]).reverse()];
    mark(group, 'path', { class: 'band', d: path_of(band) });
  }
  for (const run of runs) mark(group, 'path', { d: path_of(run.map(p => [p.x, p.y])) });
  if (points.length < MOST_DOTTED) points.forEach(p => mark(group, 'circle', { cx: p.x, cy: p.y, r: DOT }));
  return group;
}

// Returns the points of a line in pieces: a gap of many times the usual distance has no line.
function runs_of(points) {
  const gaps = points.slice(1).map((p, n) => p.at - points[n].at).sort((a, b) => a - b);
  const longest = LONGEST_GAP * (gaps[Math.floor(gaps.length / 2)] ?? 0), runs = [];
  points.forEach((point, n) => {
    if (!n || point.at - points[n - 1].at > longest) runs.push([]);
    runs.at(-1).push(point);
  });
  return runs;
}

function readout_of(sensor, point) {
  if (!point) return '';
  const { tag, at, value, low, high } = point;
  const time = state.clock === 'wall' ? clock(at) : day_time(at / SECOND_MS);
  const range = low < high ? ` (${low.toFixed(sensor.decimals)} to ${high.toFixed(sensor.decimals)})` : '';
  return `tag ${tag.id}, ${time}: ${with_unit(sensor, value)}${range}`;
}

// The axes

// Returns the first and the last time of day in ms. It ends on the next day if midnight is within the readings.
function day_span() {
  const times = [...new Set(data.sensors.flatMap(({ lines }) => lines.flatMap(line => line.day.map(([at]) => at))))];
  times.sort((a, b) => a - b);
  const gaps = times.map((at, n) => (times[n + 1] ?? times[0] + DAY_SECONDS) - at), longest = Math.max(...gaps);
  if (longest < DAY_SECONDS / 4) return [0, DAY_MS];
  const last = times[gaps.indexOf(longest)], first = (last + longest) % DAY_SECONDS;
  return [first * SECOND_MS, (last < first ? last + DAY_SECONDS : last) * SECOND_MS];
}

function time_axis(width) {
  const is_wall = state.clock === 'wall', [first, last] = is_wall ? data.span_ms : day_span();
  const room = Math.max((last - first) * TIME_ROOM, is_wall ? SMALLEST_WALL_ROOM_MS : SMALLEST_DAY_ROOM_MS);
  const low = first - room, high = last + room;
  const least = (high - low) / Math.max(width / (is_wall ? WALL_STEP : DAY_STEP), 1);
  const step = WALL_STEPS_MS.find(ms => ms >= least) ?? Math.ceil(least / DAY_MS) * DAY_MS;
  const offset = is_wall ? new Date(first).getTimezoneOffset() * MINUTE_MS : 0;
  const every = ms => ticks_of(low - offset, high - offset, ms).map(at => at + offset), ticks = every(step);
  const length = (step < MINUTE_MS ? 'HH:MM:SS' : 'HH:MM').length, year = ' YYYY'.length;
  const wall_text = ms => step >= DAY_MS ? date(ms).slice(0, -year) : clock(ms).slice(0, length);
  return {
    low, high, ticks: ticks.length < 2 ? [first, last] : ticks,
    halves: step === HOUR_MS ? every(step / 2) : [],
    text: is_wall ? wall_text : ms => day_time(ms / SECOND_MS),
    ms_of: is_wall ? ms => first + ms
      : seconds => seconds * SECOND_MS + (seconds * SECOND_MS < first ? DAY_MS : 0),
  };
}

// The range of the colours if all values are in it, with some room at both ends.
function value_axis({ extent, limits, decimals }) {
  const [low, high] = extent[0] < limits[0] || extent[1] > limits[1] ? extent : limits;
  const room = Math.max(VALUE_ROOM * (high - low), Math.abs(high) * SMALLEST_ROOM, 10 ** -decimals);
  const bottom = low - room, top = high + room, step = nice_step((top - bottom) / VALUE_TICKS), rounding = 1e-9;
  const digits = Math.max(0, -Math.floor(Math.log10(step) + rounding));
  return { bottom, top, ticks: ticks_of(bottom, top, step), text: value => value.toFixed(digits) };
}

// The labels at the ends of the lines

// Returns the room for these labels, which stand in several columns if they are many.
function column_of(sensor, height) {
  const lines = sensor.lines.filter(line => line[state.clock].length > 1);
  const texts = lines.map(line => end_text(sensor, data.tags[line.tag]));
  const count = texts.length > MOST_LABELLED ? 1 : Math.ceil(texts.length * LINE_STEP / (height - ABOVE - BELOW));
  const widest = Math.min(Math.max(...texts.map(width_of), NARROWEST_LABEL), WIDEST_LABEL) + LABEL_SPACE;
  const width = count ? LABEL_GAP + count * widest : BESIDE_LONE;
  return { count, widest, width, low: ABOVE, high: height - BELOW };
}

// Returns the nearest places to these, in their order, which are this far apart and within the limits.
function spread(places, apart, low, high) {
  const blocks = [], mean = ({ sum, count }) => sum / count;
  places.forEach((place, number) => {
    let block = { sum: place - number * apart, count: 1 };
    while (blocks.length && mean(blocks.at(-1)) > mean(block)) {
      const { sum, count } = blocks.pop();
      block = { sum: sum + block.sum, count: count + block.count };
    }
    blocks.push(block);
  });
  const highest = high - (places.length - 1) * apart;
  return blocks.flatMap(block => Array(block.count).fill(clamp(mean(block), low, highest)))
    .map((place, number) => place + number * apart);
}

// Labels the end of each line in columns at the right; returns the boxes of the labels.
function label_ends(lines, { count, widest, low, high }, column) {
  const ends = lines.map(line => ({ ...line, ...line.points.at(-1) })).sort((one, other) => one.y - other.y);
  const is_spare = ends.length > MOST_LABELLED;
  return spread(ends.map(end => end.y), LINE_STEP / count, low, high).map((y, number) => {
    const end = ends[number], left = column + number % count * widest + LABEL_SPACE / 2;
    const width = width_of(end.text), box = around(left + width / 2, is_spare ? end.y : y, width, TEXT_HEIGHT);
    if (!is_spare) draw_leader(end.group, end.x + LONE_RADIUS, end.y, left - LABEL_SPACE / 2, y);
    write_in(end.group, box, is_spare ? 'halo spare' : 'halo', end.text);
    return box;
  });
}

// Labels each point of a tag that has only one beside it.
function label_points(lines, room, taken_by_ends) {
  const points = lines.flatMap(line => line.points.map(p => around(p.x, p.y, POINT_WIDTH, POINT_WIDTH)));
  const lone = lines.filter(line => line.points.length === 1).map(({ group, text, is_bold, points: [{ x, y }] }) => {
    const radius = is_bold ? BOLD_RADIUS : LONE_RADIUS;
    return { group, text, label: { x, y, radius, outer: DOT, width: width_of(text) + LONE_SPACE } };
  });
  const labels = lone.map(({ label }) => label);
  const surroundings = { taken: [...points, ...taken_by_ends], room, route: [], dots: labels };
  plan_labels(labels, surroundings);
  for (const { group, text, label } of lone) label_dot(group, label, surroundings, 'halo', text);
}
