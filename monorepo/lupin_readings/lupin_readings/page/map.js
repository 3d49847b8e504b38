// The map with its key, and the small maps of the tabs.
import {
  address, clamp, data, element, facts_of, failure_words, is_extreme, nice_step, NO_ROOM, placed_tags, short, state,
  ticks_of,
} from './data.js';
import {
  cross_at, filled, HALF_TEXT, mark, nearest, path_of, rem, size_of, start_drawing, width_of, write,
} from './drawing.js';
import { around, label_dot, leader_to, place_label, plan_labels, SPACE, write_in } from './labels.js';
import { choose, show_chosen } from './choice.js';

const MARGINS = { left: 32, right: 1, top: 6, bottom: 20 };  // around the map, for its axes
const AXIS_STEP = 60;  // at least, between two numbers
const BELOW_MAP = 15, LEFT_OF_MAP = 7, LEFT_OF_NAME = 9;  // of the numbers and names of the axes
const BAR_SHARE = 0.6;  // width of the colour bar, as a share of the map
const LARGEST_DOT = 7, SMALLEST_DOT = 2.5, EMPTY_DOT = 4.5;  // radii
const EXTREME_RING = 3;  // around the dot of the lowest and of the highest value
const WIDEST_ID = 12;  // characters of an id that are bold; each takes one more unit
const FAILED_BESIDE = 0.2;  // extra cost of a failed tag's label at its side, where it looks like part of a value
const ROUTE_STEP = 6, ROUTE_WIDTH = 4, ARROW_WIDTH = 6;  // of the boxes along the route that labels avoid
const STOP_RADIUS = 3, START_RADIUS = 4.5, END_SIDE = 8;  // of the marks on the route
const END_WIDTH = 10, END_RADIUS = 5, END_SPACE = 16;  // of the words at its ends
const ARROW = 'M5 0L-4 -3.5L-4 3.5Z';
const ONE_PLACE_M = 0.1;  // a route that ends this near to its start is round
const GOAL_RADIUS = 4, GOAL_WIDTH = 12;  // of where the robot could not stand
const FINGER = 22;  // is larger than a dot
const TAB_HEIGHT = 220, TAB_MARGIN = 2, TAB_DOT_M = 0.22, SMALLEST_TAB_DOT = 1.5, LARGEST_TAB_DOT = 6;
const TAB_CROSS = 0.75;  // the arm of a cross, in radii of a dot
const BAR_TICKS = 6, FROM_BAR_END = 0.12;  // numbers below the bar, and how far from its ends they are
const [view_x0, view_y0, view_x1, view_y1] = data.view;
export const aspect = (view_x1 - view_x0) / (view_y1 - view_y0);

// Returns how metres become units in a drawing of at most this size.
function frame_of(width, height, { left, right, top, bottom }) {
  const inner_width = width - left - right, inner_height = height - top - bottom, smallest = 1e-6;
  const fitting = Math.min(inner_width / (view_x1 - view_x0), inner_height / (view_y1 - view_y0));
  const scale = Math.max(fitting, smallest), start = left + (inner_width - (view_x1 - view_x0) * scale) / 2;
  const x = at => start + (at - view_x0) * scale, y = at => top + (view_y1 - at) * scale;
  const room = [x(view_x0), y(view_y1), x(view_x1), y(view_y0)];
  return { scale, x, y, width: Math.max(width, 1), height: y(view_y0) + bottom, room };
}

export function draw_map() {
  const place = element('map'), number = state.sensor, sensor = data.sensors[number];
  const frame = frame_of(size_of(place)[0], Infinity, MARGINS);
  const name = 'Map of the greenhouse. The arrow keys choose the next tag.';
  const svg = start_drawing(place, frame.width, frame.height, { role: 'group', 'aria-label': name });
  draw_axes(svg, frame);
  draw_ground(svg, frame);
  draw_route(svg, frame);
  const dots = dots_of(frame, sensor, number), surroundings = surroundings_of(frame, dots);
  write_ends_of_route(svg, frame, surroundings);
  for (const dot of dots) if (dot.tag.goal) draw_goal(svg, frame, dot, surroundings);
  dots.sort((one, other) => other.urgency - one.urgency);
  plan_labels(dots.map(({ label }) => label), surroundings);
  for (const dot of dots) draw_tag(svg, dot, surroundings);
  const unlabelled = svg.querySelectorAll('.spare').length;
  element('unlabelled').textContent = unlabelled ? `${unlabelled} ${NO_ROOM}` : '';
  svg.addEventListener('click', event => event.target.closest('a') || choose(nearest(dots, svg, event, FINGER)?.tag));
  write_key(sensor, frame);
  show_chosen();
}

// Returns a dot with its label for each tag.
function dots_of(frame, sensor, number) {
  const largest = clamp(data.closest_m * frame.scale / 2 - 1, SMALLEST_DOT, LARGEST_DOT);  // the closest do not touch
  return placed_tags.map(tag => {
    const value = tag.values[number] ?? null, is_large = tag.has_failed || value !== null;
    const radius = is_large ? largest : Math.min(largest, EMPTY_DOT);
    const outer = radius + (is_extreme(sensor, tag) ? EXTREME_RING : 0), text = text_beside(tag, value, sensor);
    const width = width_of(tag.id + text) + Math.min(tag.id.length, WIDEST_ID) + SPACE;
    const place = { x: frame.x(tag.x), y: frame.y(tag.y) }, beside = tag.has_failed ? FAILED_BESIDE : 0;
    const label = { ...place, radius: outer, width, pad: SPACE / 2, beside };
    return { ...place, radius, outer, label, text, tag, value, urgency: is_large + tag.has_failed };
  });
}

// Returns what is written after the id of a tag.
function text_beside(tag, value, sensor) {
  if (tag.has_failed) return failure_words.length > 1 ? ` ${tag.outcome}` : '';
  if (value === null) return '';
  const { decimals, limits: [low, high] } = sensor;
  return `: ${value.toFixed(decimals)}${value > high ? ' ▲' : value < low ? ' ▼' : ''}`;
}

// Returns what the labels must avoid.
function surroundings_of(frame, dots) {
  const stops = data.stops.map(([x, y]) => ({ x: frame.x(x), y: frame.y(y) }));
  return {
    taken: dots.map(({ x, y, outer }) => around(x, y, 2 * outer + SPACE, 2 * outer)),
    room: frame.room,
    route: [
      ...boxes_of_route(frame),
      ...data.arrows.map(([x, y]) => around(frame.x(x), frame.y(y), ARROW_WIDTH, ARROW_WIDTH)),
    ],
    dots: [...dots, ...stops],
    more: [[0.25, -1]],
  };
}

function draw_axes(svg, { x, y, scale, room: [left, , , bottom] }) {
  const step = nice_step(AXIS_STEP / scale);
  for (const at of ticks_of(view_x0, view_x1, step)) write(svg, x(at), bottom + BELOW_MAP, short(at, 6), 'middle');
  for (const at of ticks_of(view_y0, view_y1, step)) {
    write(svg, left - LEFT_OF_MAP, y(at) + HALF_TEXT, short(at, 6), 'end');
  }
  // The names stand between the last two numbers.
  const [name_x, name_y] = [[view_x0, view_x1], [view_y0, view_y1]]
    .map(ends => (ticks_of(...ends, step).at(-1) ?? ends[1]) - step / 2);
  write(svg, x(name_x), bottom + BELOW_MAP, 'x (m)', 'middle');
  const turned = mark(svg, 'g', { transform: `translate(${left - LEFT_OF_NAME} ${y(name_y)}) rotate(-90)` });
  write(turned, 0, 0, 'y (m)', 'middle');
}

function draw_ground(svg, { x, y, scale }) {
  [data.walls, ...data.tables].forEach(([x0, y0, x1, y1], number) => mark(svg, 'rect', {
    class: number ? 'bench' : 'wall', x: x(x0), y: y(y1), width: (x1 - x0) * scale, height: (y1 - y0) * scale,
  }));
}

// The route

function draw_route(svg, { x, y }) {
  if (data.route.length < 2) return;
  const points = data.route.map(([at_x, at_y]) => [x(at_x), y(at_y)]), [start, end] = [points[0], points.at(-1)];
  mark(svg, 'path', { class: 'route', d: path_of(points) });
  for (const [at_x, at_y, heading] of data.arrows) {
    const transform = `translate(${x(at_x)} ${y(at_y)}) rotate(${-heading * 180 / Math.PI})`;
    mark(svg, 'path', { class: 'arrow', d: ARROW, transform });
  }
  for (const [cx, cy] of data.stops) mark(svg, 'circle', { class: 'stop', cx: x(cx), cy: y(cy), r: STOP_RADIUS });
  mark(svg, 'circle', { class: 'end', cx: start[0], cy: start[1], r: START_RADIUS });
  const [left, top] = end.map(centre => centre - END_SIDE / 2);
  mark(svg, 'rect', { class: 'end', x: left, y: top, width: END_SIDE, height: END_SIDE });
}

// Returns small boxes along the route.
function boxes_of_route({ x, y }) {
  const boxes = [];
  let left = 0;  // to the next box
  data.route.slice(1).forEach(([to_x, to_y], number) => {
    const [from_x, from_y] = data.route[number], dx = x(to_x) - x(from_x), dy = y(to_y) - y(from_y);
    const length = Math.hypot(dx, dy);
    for (; left < length; left += ROUTE_STEP) {
      const share = left / length;
      boxes.push(around(x(from_x) + dx * share, y(from_y) + dy * share, ROUTE_WIDTH, ROUTE_WIDTH));
    }
    left -= length;
  });
  return boxes;
}

function write_ends_of_route(svg, frame, surroundings) {
  if (data.route.length < 2) return;
  const [start, end] = [data.route[0], data.route.at(-1)];
  const is_round = Math.hypot(start[0] - end[0], start[1] - end[1]) < ONE_PLACE_M;
  for (const [word, at] of is_round ? [['start, end', start]] : [['start', start], ['end', end]]) {
    const x = frame.x(at[0]), y = frame.y(at[1]);
    const { box } = place_label({ x, y, radius: END_RADIUS, width: width_of(word) + END_SPACE }, surroundings);
    surroundings.taken.push(around(x, y, END_WIDTH, END_WIDTH), box);
    write_in(svg, box, 'muted halo', word);
  }
}

// Draws where the robot could not stand, with a line to the tag that it could not read.
function draw_goal(svg, frame, { x, y, outer, tag }, { taken, route }) {
  const [cx, cy] = [frame.x(tag.goal[0]), frame.y(tag.goal[1])], box = around(cx, cy, GOAL_WIDTH, GOAL_WIDTH);
  mark(svg, 'path', { class: 'unreached', d: path_of([[cx, cy], [x, y]]) });
  mark(svg, 'circle', { class: 'unreached', cx, cy, r: GOAL_RADIUS });
  taken.push(box);
  route.push(...leader_to(x, y, outer, box));
}

function draw_tag(svg, { tag, value, x, y, radius, outer, urgency, label, text }, surroundings) {
  const name = tag.has_failed ? 'failed' : '';
  const group = mark(svg, 'a', { class: name, href: address(tag.id), 'data-tag': tag.id, tabindex: -1 });
  const circle = (className, r, more) => mark(group, 'circle', { class: className, cx: x, cy: y, r, ...more });
  mark(group, 'title', {}, facts_of(tag).join(' · '));  // its name for a screen reader, too
  if (outer > radius) circle('extreme', outer);
  circle('ring', radius + EXTREME_RING);
  if (value === null) circle('dot empty', radius);
  else circle('dot value', radius, filled(data.sensors[state.sensor].colours[tag.number]));
  if (tag.has_failed) mark(group, 'path', { class: 'cross', d: cross_at(x, y, radius / 2) });
  const written = label_dot(group, label, surroundings, urgency ? 'halo' : 'muted halo');
  mark(written, 'tspan', { class: urgency ? 'id' : '' }, tag.id);
  if (text) mark(written, 'tspan', {}, text);
}

function write_key(sensor, { room: [left, , right] }) {
  element('bar').hidden = !sensor;
  if (!sensor) return;
  const [low, high] = sensor.limits, share = at => (at - low) / (high - low);
  const bar = document.querySelector('#bar .colours');
  Object.assign(bar.style, { marginLeft: rem(left), width: rem(BAR_SHARE * (right - left)) });
  const is_inner = at => share(at) > FROM_BAR_END && share(at) < 1 - FROM_BAR_END;
  const inner = ticks_of(low, high, nice_step((high - low) / BAR_TICKS)).filter(is_inner);
  bar.ariaLabel = `Colours from ${low} to ${high} ${sensor.unit}`;
  bar.replaceChildren();
  for (const at of [low, ...inner, high]) mark(bar, 'span', { style: `left: ${100 * share(at)}%` }, short(at, 4));
  const values = data.tags.map(tag => tag.values[state.sensor]).filter(value => value !== null);
  const outside = values.filter(value => value < low || value > high).length;
  element('outside').textContent = outside ? `▲ above, ▼ below the scale: ${outside}` : '';
  element('without').textContent = `no ${sensor.name}${data.is_complete ? ' sensor' : ''}`;
}

// The tabs

export function draw_tab(sensor, number) {
  const tab = mark(element('tabs'), 'button', { type: 'button', role: 'tab', 'aria-controls': 'panel' });
  tab.addEventListener('click', () => pick(number));
  mark(tab, 'b', {}, sensor.name);
  draw_small_map(tab, sensor);
  mark(tab, 'span', {}, sensor.value_range);
  const [low, high] = sensor.limits.map(limit => short(limit, 3));
  const key = mark(tab, 'span', { class: 'key' });
  key.append(`${low} `, mark(key, 'i', { class: 'colours' }), ` ${high}`);
  for (const [text] of sensor.extremes) mark(tab, 'span', { class: 'extremes' }, text);
}

function draw_small_map(tab, sensor) {
  const margins = { left: TAB_MARGIN, right: TAB_MARGIN, top: TAB_MARGIN, bottom: TAB_MARGIN };
  const frame = frame_of(TAB_HEIGHT * aspect, TAB_HEIGHT, margins);
  const svg = mark(tab, 'svg', { viewBox: `0 0 ${frame.width} ${frame.height}`, 'aria-hidden': true });
  draw_ground(svg, frame);
  const radius = clamp(frame.scale * TAB_DOT_M, SMALLEST_TAB_DOT, LARGEST_TAB_DOT);
  const dots = placed_tags.map(tag => ({
    x: frame.x(tag.x), y: frame.y(tag.y), fill: sensor.colours[tag.number], has_failed: sensor.failed[tag.number],
  })).filter(({ has_failed, fill }) => has_failed || fill).sort((one, other) => one.has_failed - other.has_failed);
  for (const { x, y, has_failed, fill } of dots) {
    const circle = { class: 'value', cx: x, cy: y, r: radius, stroke: 'currentColor' };
    const d = cross_at(x, y, TAB_CROSS * radius);
    if (has_failed) for (const name of ['around', 'cross']) mark(svg, 'path', { class: `${name} thin`, d });
    else mark(svg, 'circle', { ...circle, ...filled(fill) });
  }
}

// Shows another sensor in the map.
export function pick(number) {
  const count = data.sensors.length, sensor = data.sensors[state.sensor = (number + count) % count];
  [...element('tabs').children].forEach((tab, n) => {
    tab.ariaSelected = n === state.sensor;
    tab.tabIndex = n === state.sensor ? 0 : -1;
  });
  element('shown').textContent = sensor.label;
  element('extremes').replaceChildren();
  sensor.extremes.forEach(([text], n, { length }) => {
    const comma = n + 1 < length ? ',' : '';
    mark(element('extremes'), 'span', {}, n ? text : `ringed: ${text}`, comma).before(n ? ' ' : '');
  });
  draw_map();
}
