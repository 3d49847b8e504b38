// Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
'use strict';
// Draws the page of readings from the data in it. The address tells which tag is chosen: #tag=28.
const element = id => document.getElementById(id);
const data = JSON.parse(element('data').textContent);
const TAB_HEIGHT = 220;
const LONG_LINE = 40;  // points, from which a chart is as wide as the page
const MOST_LABELLED = 100;  // lines of a chart; of more, only the chosen one has a label
const ONE_MOMENT_MS = 1000, ONE_TIME_MS = 60000;  // in which a chart, and the times of tags, would say nothing
const NO_ROOM = 'of the numbers have no room: choose a tag to see its own';
// A drawing is in units of 1/16 of the page's font size, which grows with the window.
const TEXT_HEIGHT = 13, SPACE = 8;  // of a label, and between it and what is beside it
const CLEAR = 12;  // from a label to the ring of another tag, if it can
const SHORTEST_LEADER = 10, GAP = 3;  // of the line from a dot to its label, and between the two
const ONE_PLACE_M = 0.1;  // in which a route ends where it starts
const ROUTE_STEP = 6;  // between the boxes along the route that labels avoid
const LINE_STEP = 11;  // between the labels at the ends of the lines of a chart
const BESIDE_LONE = 22;  // at both ends of a chart of points without a line, room for their labels
const FROM_AXIS = 6;  // of a label in a chart
const APART = 7;  // between points of a chart at one time, so that none covers another
const FARTHEST = 8;  // rings of places for a label around its dot, but only one in a crowd
const CROWD = 200;  // boxes near a dot, or labels
const DAY_SECONDS = 86400, DAY_MS = DAY_SECONDS * 1000, HOUR_MS = DAY_MS / 24;
const WALL_STEPS_MS = [
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, DAY_SECONDS,
].map(seconds => seconds * 1000);
const KEY_STEPS = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
data.tags.forEach((tag, number) => { tag.number = number; });
for (const { extremes, unit } of data.sensors) {
  for (const each of extremes) each[0] = each[0].replace(` ${unit}`, `\u00a0${unit}`);  // on one line
}
const is_line = data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > 1));
const is_long = data.sensors.length === 1
  || data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > LONG_LINE));
const [view_x0, view_y0, view_x1, view_y1] = data.view, aspect = (view_x1 - view_x0) / (view_y1 - view_y0);
const placed_tags = data.tags.filter(tag => tag.x !== null);
const state = { sensor: 0, clock: 'wall' };
const pen = document.createElement('canvas').getContext('2d');
pen.font = '11px system-ui, sans-serif';

// Appends an element of HTML or SVG, whichever the parent is, with the texts or elements in it.
function mark(parent, name, attributes = {}, ...children) {
  const space = name === 'svg' ? 'http://www.w3.org/2000/svg' : parent.namespaceURI;
  const child = parent.appendChild(document.createElementNS(space, name));
  for (const [key, value] of Object.entries(attributes)) child.setAttribute(key, value);
  child.append(...children);
  return child;
}

// Returns the size of an element in units.
function size_of(place) {
  const { width, height } = place.getBoundingClientRect();
  const unit = parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
  return [width / unit, height / unit];
}

function start_drawing(parent, width, height, more) {
  parent.replaceChildren();
  const size = { width: `${width / 16}rem`, height: `${height / 16}rem` };
  return mark(parent, 'svg', { ...size, viewBox: `0 0 ${width} ${height}`, ...more });
}

// Returns the point of a drawing that is nearest to an event and less far from it than this.
function nearest(points, svg, event, farthest) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const distance = p => Math.hypot(p.x - x, p.y - y);
  return points.reduce((best, p) => distance(p) < (best ? distance(best) : farthest) ? p : best, null);
}

// Writes texts with a dot between them, with which no line begins or ends.
function write_pieces(place, texts, is_bad = () => false) {
  place.replaceChildren();
  place.classList.toggle('pieces', texts.length > 0);
  texts.forEach((text, number) => {
    const piece = mark(place, 'span');
    mark(piece, 'i', {}, number ? ' · ' : '');
    mark(piece, 'span', { class: is_bad(number) ? 'bad' : '' }, text);
  });
}

const write = (svg, x, y, text, anchor, name = 'muted') =>
  mark(svg, 'text', { class: name, x, y, 'text-anchor': anchor }, text);
const path_of = points => `M${points.map(point => point.map(each => each.toFixed(1)).join()).join('L')}`;
const cross_at = (x, y, arm) => `M${x - arm} ${y - arm}l${2 * arm} ${2 * arm}m${-2 * arm} 0l${2 * arm} ${-2 * arm}`;
const width_of = text => pen.measureText(text).width;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const short = (number, digits) => String(Number(number.toPrecision(digits)));
const pad = number => String(number).padStart(2, '0');
const clock = ms => new Date(ms).toTimeString().slice(0, 8);
const date = ms => new Date(ms).toLocaleDateString('en-GB', { day: 'numeric', month: 'short', year: 'numeric' });
const day_time = seconds => `${pad(Math.floor(seconds / 3600) % 24)}:${pad(Math.floor(seconds / 60) % 60)}`;
const with_unit = (sensor, value) => `${value.toFixed(sensor.decimals)}\u00a0${sensor.unit}`.trim();
const filled = fill => ({ fill, style: `--value: ${fill}` });
const is_extreme = (sensor, tag) => sensor?.extremes.some(([, ids]) => ids.includes(tag.id));
const address = id => `#tag=${encodeURIComponent(id)}`;
const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
const short_zone = ms => new Date(ms).toLocaleTimeString('en-GB', { timeZoneName: 'short' }).split(' ').at(-1);
const is_one_day = new Set(data.span_ms.map(date)).size <= 1;
const last_stamps = data.tags.map(tag => tag.stamp_ms).filter(ms => ms !== null).sort((a, b) => a - b);
const dates_in_table = [...new Set(last_stamps.map(date))];
const tags_in_table = data.tags.filter(tag => tag.has_failed || tag.outcome === 'read');
// If all failures have the same word, it stands in the key and not beside each tag.
const failure_words = [...new Set(data.tags.filter(tag => tag.has_failed).map(tag => tag.outcome))];
// Returns the names of the sensors that a failed tag has.
const list = new Intl.ListFormat('en-GB');
const lost_of = tag => list.format(data.sensors.filter(each => each.failed[tag.number]).map(each => each.name));

// The head

function write_head() {
  const whole = text => text.replaceAll(' ', '\u00a0');  // does not break
  const ends = new Set(data.span_ms.map(ms => whole(`${is_one_day ? '' : `${date(ms)} `}${clock(ms)}`)));
  const duration = ends.size > 1 ? ` (${whole(data.duration)})` : '', last = data.span_ms.at(-1);
  const span = ends.size ? `${[...ends].join(' to ')} ${short_zone(last)}${duration}` : '';
  const when = is_one_day && span ? [whole(date(last)), whole(span)] : [span];
  element('title').textContent = ['Simulated readings', ...when].filter(Boolean).join(', ');
  write_pieces(element('counts'), data.counts.map(([text]) => text), number => data.counts[number][1]);
  write_pieces(element('file'), [data.title, data.greenhouse_times].filter(Boolean));
  data.failures.forEach(each => write_tags(mark(element('failures'), 'li'), each, 'bad'));
  data.notes.forEach(note => mark(element('notes'), 'p', {}, note));
}

// Writes which tags were not read, and why: what happened, and then, small, with which code.
function write_tags(line, { word, reason, tags, more }, name) {
  line.append(tags.length + Boolean(more) > 1 ? 'Tags ' : 'Tag ');
  tags.forEach((id, number) => {
    if (number) line.append(number + 1 < tags.length || more ? ', ' : ' and ');
    mark(line, 'a', { href: address(id) }, id);
  });
  const lone = tags.length === 1 && !more ? data.tags.find(tag => tag.id === tags[0]) : null;
  const lost = lone && lost_of(lone);
  line.append(more, lost ? ` (${lost}) ` : ' ');
  mark(line, 'span', { class: name }, word);
  const [, plain, code = ''] = /^(.*?)(?: (\(Nav2 code \d+\)))?$/s.exec(reason);
  if (plain) line.append(`: ${plain}`);
  if (code) mark(line, 'small', {}, code.replaceAll(' ', '\u00a0')).before(' ');
}

// Boxes [left, top, right, bottom] and the places of labels

const around = (x, y, width, height) => [x - width / 2, y - height / 2, x + width / 2, y + height / 2];
const common = (a, b) => Math.max(Math.min(a[2], b[2]) - Math.max(a[0], b[0]), 0)
  * Math.max(Math.min(a[3], b[3]) - Math.max(a[1], b[1]), 0);

const wide = ([left, top, right, bottom]) => [left - SPACE, top + 4, right + SPACE, bottom - 4];
const parts = ({ box, leader }) => [box, ...leader];

// Returns the box around a dot in which a label and the line to it cover least, how much they cover there,
// this line, and whether it is needed to tell whose label it is. If it must, a label may cross the `route`, may
// be nearer to another of the `dots`, and may lie where other labels are planned, which `weight` makes dear. It is
// beside, above or below its dot, slanting, or at `more` places, in shares of the distance aside and above.
// At both ends of a text is an empty `pad`. A place `beside` the dot can cost more, as a share of the area.
function place_label({ x, y, radius, width, pad = 0, beside = 0 }, boxes_around, weight = 25) {
  const { taken, room, route, dots = [], more = [], plans = new Map() } = boxes_around;
  const aside = radius + width / 2 + 4, above = radius + TEXT_HEIGHT / 2 + 1, area = width * TEXT_HEIGHT;
  const mirrored = ([a, b], dx, dy) => [[a, b], [-a, b], [a, -b], [-a, -b]].map(at => [at[0] * dx, at[1] * dy]);
  const slants = [...more, [0.5, -1], [1, 0.75], [1, 0.4]], ring = (dx, dy) =>
    [[dx, 0], [-dx, 0], [0, -dy], [0, dy], ...slants.flatMap(at => mirrored(at, dx, dy))];
  const reach = around(x, y, 2 * (aside + 12 * FARTHEST) + width, 2 * (above + 11 * FARTHEST + TEXT_HEIGHT));
  const planned = [...plans.values()].flatMap(each => [...parts(each), wide(each.box)]);
  const [boxes, steps, others] = [taken, route, planned]
    .map(each => each.filter(box => common(reach, box) > 0));
  const shared_by = (place, all) =>
    parts(place).reduce((sum, box) => all.reduce((more, other) => more + common(box, other), sum), 0);
  const rings = boxes.length > CROWD ? 1 : FARTHEST;
  const near = dots.filter(dot => common(reach, around(dot.x, dot.y, 1, 1)) && (dot.x !== x || dot.y !== y));
  const gap = ([left, top, right, bottom], dot) =>
    Math.hypot(clamp(dot.x, left + pad, right - pad) - dot.x, clamp(dot.y, top, bottom) - dot.y);
  let best = { cost: Infinity };
  for (let far = 0; far < rings && best.cost > 0.2 * far * area; far++) {
    ring(aside + 12 * far, above + 11 * far).forEach(([dx, dy], number) => {
      const box = around(x + dx, y + dy, width, TEXT_HEIGHT), outside = area - common(box, room);
      const leader = far ? leader_to(x, y, radius + SPACE, box) : [];
      const place = { box, leader }, covered = outside + shared_by(place, boxes);
      const nearer = near.filter(dot => gap(box, dot) < gap(box, { x, y })), is_misread = nearer.length > 0;
      const is_at_stop = nearer.some(dot => !dot.outer);
      const is_close = near.some(dot => gap(box, dot) < dot.outer + CLEAR);
      const cost = 9999 * (covered > 1) + 99 * covered + 9 * shared_by(place, steps) + weight * shared_by(place, others)
        + (0.2 * far + 0.8 * is_misread + 0.35 * is_at_stop + 0.1 * is_close + 0.1 * (number > 3) + 0.005 * number
          + beside * (number < 2)) * area;
      if (cost < best.cost) best = { ...place, cost, covered, has_leader: far > 0 || is_misread };
    });
  }
  return best;
}

// Returns small boxes along the line from a dot to its label, without those on the dot.
function leader_to(x, y, radius, [left, top, right, bottom]) {
  const dx = clamp(x, left, right) - x, dy = clamp(y, top, bottom) - y, length = Math.hypot(dx, dy);
  const steps = { length: Math.max(Math.floor((length - radius) / 3), 0) };
  return Array.from(steps, (_, n) => 1 - (n + 1) * 3 / length)
    .map(share => around(x + share * dx, y + share * dy, 2, 2));
}

const write_in = (parent, [left, , right, bottom], name, text = '') =>
  write(parent, (left + right) / 2, bottom - 3, text, 'middle', name);
const draw_leader = (parent, x1, y1, x2, y2) =>
  parent.prepend(mark(parent, 'line', { class: 'leader', x1, y1, x2, y2 }));

// Plans the places of labels several times, so that one gives way to another that has fewer places.
function plan_labels(labels, boxes) {
  boxes.plans = new Map();
  for (const weight of labels.length > CROWD ? [] : [1, 5, 25]) {
    for (const label of labels) {
      boxes.plans.delete(label);
      boxes.plans.set(label, place_label(label, boxes, weight));
    }
  }
}

// Labels a dot, and returns its text. A label without a free place is shown if its tag is chosen.
function label_dot(group, label, boxes, name, text) {
  boxes.plans.delete(label);
  const place = place_label(label, boxes), { box, covered, has_leader } = place, is_spare = covered > 1;
  const { x, y, radius } = label;
  if (!is_spare) {
    boxes.taken.push(...parts(place));
    boxes.route.push(wide(box));  // no other label, if it can
    const [left, top, right, bottom] = box;
    const dx = clamp(x, left, right) - x, dy = clamp(y, top, bottom) - y, share = 1 - GAP / Math.hypot(dx, dy);
    const is_long_enough = share * Math.hypot(dx, dy) - radius >= SHORTEST_LEADER;
    if (has_leader && is_long_enough) draw_leader(group, x, y, x + share * dx, y + share * dy);
  }
  return write_in(group, box, is_spare ? `${name} spare` : name, text);
}

// The map, and the small ones of the tabs

// Returns how metres become pixels in a picture of at most this size.
function frame_of(width, height, { left, right, top, bottom }) {
  const [x0, y0, x1, y1] = data.view, inner_width = width - left - right;
  const scale = Math.max(Math.min(inner_width / (x1 - x0), (height - top - bottom) / (y1 - y0)), 1e-6);
  const start = left + (inner_width - (x1 - x0) * scale) / 2, x = at => start + (at - x0) * scale;
  const y = at => top + (y1 - at) * scale;
  return { scale, x, y, width: Math.max(width, 1), height: y(y0) + bottom, room: [x(x0), y(y1), x(x1), y(y0)] };
}

function draw_ground(svg, { x, y, scale }) {
  [data.walls, ...data.tables].forEach(([x0, y0, x1, y1], number) => mark(svg, 'rect', {
    class: number ? 'bench' : 'wall', x: x(x0), y: y(y1), width: (x1 - x0) * scale, height: (y1 - y0) * scale,
  }));
}

function draw_route(svg, { x, y }) {
  if (data.route.length < 2) return;
  const points = data.route.map(([at_x, at_y]) => [x(at_x), y(at_y)]), [start, end] = [points[0], points.at(-1)];
  mark(svg, 'path', { class: 'route', d: path_of(points) });
  for (const [at_x, at_y, heading] of data.arrows) {
    const transform = `translate(${x(at_x)} ${y(at_y)}) rotate(${-heading * 180 / Math.PI})`;
    mark(svg, 'path', { class: 'arrow', d: 'M5 0L-4 -3.5L-4 3.5Z', transform });
  }
  for (const stop of data.stops) mark(svg, 'circle', { class: 'stop', cx: x(stop[0]), cy: y(stop[1]), r: 3 });
  mark(svg, 'circle', { class: 'end', cx: start[0], cy: start[1], r: 4.5 });
  mark(svg, 'rect', { class: 'end', x: end[0] - 4, y: end[1] - 4, width: 8, height: 8 });
}

// Returns small boxes along the route.
function boxes_of_route({ x, y }) {
  const boxes = [];
  let left = 0;  // to the next box
  data.route.slice(1).forEach(([to_x, to_y], number) => {
    const [from_x, from_y] = data.route[number], dx = x(to_x) - x(from_x), dy = y(to_y) - y(from_y);
    const length = Math.hypot(dx, dy);
    for (; left < length; left += ROUTE_STEP) {
      boxes.push(around(x(from_x) + dx * left / length, y(from_y) + dy * left / length, 4, 4));
    }
    left -= length;
  });
  return boxes;
}

// Returns the words at the start and the end of the route with their places.
function ends_of_route() {
  if (data.route.length < 2) return [];
  const [start, end] = [data.route[0], data.route.at(-1)];
  const is_round = Math.hypot(start[0] - end[0], start[1] - end[1]) < ONE_PLACE_M;
  return is_round ? [['start, end', start]] : [['start', start], ['end', end]];
}

function draw_axes(svg, { x, y, scale, room: [left, , , bottom] }) {
  const [x0, y0, x1, y1] = data.view, step = nice_step(60 / scale);
  for (const at of ticks_of(x0, x1, step)) write(svg, x(at), bottom + 15, short(at, 6), 'middle');
  for (const at of ticks_of(y0, y1, step)) write(svg, left - 7, y(at) + 4, short(at, 6), 'end');
  // The names stand between the last two numbers.
  const [name_x, name_y] = [[x0, x1], [y0, y1]].map(ends => (ticks_of(...ends, step).at(-1) ?? ends[1]) - step / 2);
  write(svg, x(name_x), bottom + 15, 'x (m)', 'middle');
  write(mark(svg, 'g', { transform: `translate(${left - 9} ${y(name_y)}) rotate(-90)` }), 0, 0, 'y (m)', 'middle');
}

function draw_map() {
  const place = element('map'), number = state.sensor, sensor = data.sensors[number];
  const frame = frame_of(size_of(place)[0], Infinity, { left: 32, right: 1, top: 6, bottom: 20 });
  const name = 'Map of the greenhouse. The arrow keys choose the next tag.';
  const svg = start_drawing(place, frame.width, frame.height, { role: 'group', 'aria-label': name });
  const [left, , right] = frame.room, bar = document.querySelector('#bar .colours').style;
  Object.assign(bar, { marginLeft: `${left / 16}rem`, width: `${0.6 * (right - left) / 16}rem` });
  draw_axes(svg, frame);
  draw_ground(svg, frame);
  draw_route(svg, frame);
  const largest = clamp(data.closest_m * frame.scale / 2 - 1, 2.5, 7);  // the closest dots do not touch
  const dots = placed_tags.map(tag => {
    const value = tag.values[number] ?? null, is_large = tag.has_failed || value !== null;
    const radius = is_large ? largest : Math.min(largest, 4.5), outer = radius + (is_extreme(sensor, tag) ? 3 : 0);
    const text = label_of(tag, value), width = width_of(tag.id + text) + Math.min(tag.id.length, 12) + SPACE;
    const label = { x: frame.x(tag.x), y: frame.y(tag.y), radius: outer, width, pad: SPACE / 2 };
    label.beside = tag.has_failed ? 0.2 : 0;  // where it would look like a part of the next value
    return { ...label, label, text, tag, value, radius, outer, urgency: is_large + tag.has_failed };
  });
  const boxes = {
    taken: dots.map(({ x, y, outer }) => around(x, y, 2 * outer + SPACE, 2 * outer)), room: frame.room,
    route: [
      ...boxes_of_route(frame),
      ...data.arrows.map(([x, y]) => around(frame.x(x), frame.y(y), 6, 6)),
    ],
    dots: [...dots, ...data.stops.map(([x, y]) => ({ x: frame.x(x), y: frame.y(y) }))], more: [[0.25, -1]],
  };
  for (const [word, [x, y]] of ends_of_route()) {
    const { box } = place_label({ x: frame.x(x), y: frame.y(y), radius: 5, width: width_of(word) + 16 }, boxes);
    boxes.taken.push(around(frame.x(x), frame.y(y), 10, 10), box);
    write_in(svg, box, 'muted halo', word);
  }
  for (const dot of dots) if (dot.tag.goal) draw_goal(svg, frame, dot, boxes);
  dots.sort((one, other) => other.urgency - one.urgency);
  plan_labels(dots.map(({ label }) => label), boxes);
  for (const dot of dots) draw_tag(svg, dot, boxes);
  const unlabelled = svg.querySelectorAll('.spare').length;
  element('unlabelled').textContent = unlabelled ? `${unlabelled} ${NO_ROOM}` : '';
  // A finger is larger than a dot.
  svg.addEventListener('click', event => event.target.closest('a') || choose(nearest(dots, svg, event, 22)?.tag));
  write_key(sensor);
  show_chosen();
}

// Draws where the robot could not stand, with a line to the tag that it could not read.
function draw_goal(svg, frame, { x, y, outer, tag }, { taken, route }) {
  const [cx, cy] = [frame.x(tag.goal[0]), frame.y(tag.goal[1])], box = around(cx, cy, 12, 12);
  mark(svg, 'path', { class: 'unreached', d: path_of([[cx, cy], [x, y]]) });
  mark(svg, 'circle', { class: 'unreached', cx, cy, r: 4 });
  taken.push(box);
  route.push(...leader_to(x, y, outer, box));
}

function draw_tag(svg, { tag, value, x, y, radius, outer, urgency, label, text }, boxes) {
  const name = tag.has_failed ? 'failed' : '';
  const group = mark(svg, 'a', { class: name, href: address(tag.id), 'data-tag': tag.id, tabindex: -1 });
  const circle = (className, r, more) => mark(group, 'circle', { class: className, cx: x, cy: y, r, ...more });
  mark(group, 'title', {}, facts_of(tag).join(' · '));  // its name for a screen reader, too
  if (outer > radius) circle('extreme', outer);
  circle('ring', radius + 3);
  if (value === null) circle('dot empty', radius);
  else circle('dot value', radius, filled(data.sensors[state.sensor].colours[tag.number]));
  if (tag.has_failed) mark(group, 'path', { class: 'cross', d: cross_at(x, y, radius / 2) });
  const written = label_dot(group, label, boxes, urgency ? 'halo' : 'muted halo');
  mark(written, 'tspan', { class: urgency ? 'id' : '' }, tag.id);
  if (text) mark(written, 'tspan', {}, text);
}

function label_of(tag, value) {
  if (tag.has_failed) return failure_words.length > 1 ? ` ${tag.outcome}` : '';
  if (value === null) return '';
  const { decimals, limits: [low, high] } = data.sensors[state.sensor];
  return `: ${value.toFixed(decimals)}${value > high ? ' ▲' : value < low ? ' ▼' : ''}`;
}

function write_key(sensor) {
  element('bar').hidden = !sensor;
  if (!sensor) return;
  const [low, high] = sensor.limits, share = at => (at - low) / (high - low);
  const bar = document.querySelector('#bar .colours');
  const inner = ticks_of(low, high, nice_step((high - low) / 6)).filter(at => share(at) > 0.12 && share(at) < 0.88);
  bar.ariaLabel = `Colours from ${low} to ${high} ${sensor.unit}`;
  bar.replaceChildren();
  for (const at of [low, ...inner, high]) {
    mark(bar, 'span', { style: `left: ${100 * share(at)}%` }, short(at, 4));
  }
  const values = data.tags.map(tag => tag.values[state.sensor]).filter(value => value !== null);
  const outside = values.filter(value => value < low || value > high).length;
  element('outside').textContent = outside ? `▲ above, ▼ below the scale: ${outside}` : '';
  element('without').textContent = `no ${sensor.name}${data.is_complete ? ' sensor' : ''}`;
}

function draw_tab(sensor, number) {
  const tab = mark(element('tabs'), 'button', { type: 'button', role: 'tab', 'aria-controls': 'panel' });
  tab.addEventListener('click', () => pick(number));
  mark(tab, 'b', {}, sensor.name);
  draw_small_map(tab, sensor);
  mark(tab, 'span', {}, sensor.value_range);
  const [low, high] = sensor.limits.map(each => short(each, 3));
  const key = mark(tab, 'span', { class: 'key' });
  key.append(`${low} `, mark(key, 'i', { class: 'colours' }), ` ${high}`);
  for (const [text] of sensor.extremes) mark(tab, 'span', { class: 'extremes' }, text);
}

function draw_small_map(tab, sensor) {
  const frame = frame_of(TAB_HEIGHT * aspect, TAB_HEIGHT, { left: 2, right: 2, top: 2, bottom: 2 });
  const svg = mark(tab, 'svg', { viewBox: `0 0 ${frame.width} ${frame.height}`, 'aria-hidden': true });
  draw_ground(svg, frame);
  const radius = clamp(frame.scale * 0.22, 1.5, 6);
  const dots = placed_tags.map(tag => ({
    x: frame.x(tag.x), y: frame.y(tag.y), fill: sensor.colours[tag.number], has_failed: sensor.failed[tag.number],
  })).filter(({ has_failed, fill }) => has_failed || fill).sort((one, other) => one.has_failed - other.has_failed);
  for (const { x, y, has_failed, fill } of dots) {
    const circle = { class: 'value', cx: x, cy: y, r: radius, stroke: 'currentColor' };
    const d = cross_at(x, y, 0.75 * radius);
    if (has_failed) for (const name of ['around', 'cross']) mark(svg, 'path', { class: `${name} thin`, d });
    else mark(svg, 'circle', { ...circle, ...filled(fill) });
  }
}

function pick(number) {
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

// The table

const facts_of = tag => [
  `tag ${tag.id}: ${tag.outcome}${tag.reason ? ` (${tag.reason})` : ''}`,
  ...tag.values.map((value, n) => value === null ? '' : `${data.sensors[n].name} ${with_unit(data.sensors[n], value)}`),
  tag.stamp_ms === null ? '' : `${clock(tag.stamp_ms)} (greenhouse ${day_time(tag.time_of_day)})`,
  tag.attempts > data.fewest_attempts ? `${tag.attempts} attempts` : '',
].filter(Boolean);

// What a column shows, and by what it sorts. A failed tag has its reason in place of the numbers.
const is_over_days = dates_in_table.length > 1;
const columns = [
  { name: 'tag', key: tag => tag.number },
  ...data.sensors.map((sensor, n) => ({
    name: sensor.name, unit: sensor.unit, key: tag => tag.values[n], text: value => value.toFixed(sensor.decimals),
  })),
  ...last_stamps.at(-1) - last_stamps[0] < ONE_TIME_MS ? [] : [{
    name: 'time', is_aside: true, unit: is_one_day || is_over_days ? '' : dates_in_table.join(),
    key: tag => tag.stamp_ms,
    text: ms => is_over_days ? `${date(ms)} ${clock(ms)}` : clock(ms),
  }],
  ...data.is_of_several_times ? [{
    name: 'time\u00a0of\u00a0day', is_aside: true, unit: 'greenhouse', key: tag => tag.time_of_day,
    text: day_time,
  }] : [],
  ...data.tags.some(tag => tag.attempts > data.fewest_attempts)
    ? [{ name: 'attempts', is_aside: true, key: tag => tag.attempts, text: String }] : [],
];

const asides = columns.filter(column => column.is_aside);

function write_table() {
  const table = document.querySelector('table'), head = mark(mark(table, 'thead'), 'tr');
  const choice = document.querySelector('#sort select');
  for (const column of columns) {
    const name = column.is_aside ? 'number aside' : column.text ? 'number' : '';
    const cell = mark(head, 'th', { scope: 'col', class: name });
    const sort = is_descending => {
      for (const each of head.children) each.removeAttribute('aria-sort');
      cell.ariaSort = is_descending ? 'descending' : 'ascending';
      sort_table(column.key, is_descending ? -1 : 1);
    };
    mark(cell, 'button', { type: 'button' }, column.name)
      .addEventListener('click', () => sort(cell.ariaSort === 'ascending'));
    if (column.unit) mark(cell, 'small', {}, column.unit);
    for (const arrow of '↑↓') mark(choice, 'option', {}, `${column.name} ${arrow}`).sort = () => sort(arrow === '↓');
  }
  head.firstChild.ariaSort = 'ascending';
  choice.addEventListener('change', () => choice.selectedOptions[0].sort());
  element('aside').hidden = asides.length !== 1;
  const [{ name, unit } = {}] = asides;
  element('aside').lastChild.textContent = [name, unit].filter(Boolean).join(', ');
  table.classList.toggle('timed', asides.length === 1 && !is_over_days);  // a phone shows it on the first line
  const body = mark(table, 'tbody');
  tags_in_table.forEach(tag => write_row(body, tag));
  data.unread.forEach(each => write_tags(mark(element('unread'), 'p'), each, ''));
  const search = document.querySelector('input[type=search]');
  search.hidden = tags_in_table.length <= 50;
  search.addEventListener('input', () => {
    for (const tag of tags_in_table) tag.row.hidden = !tag.id.toLowerCase().includes(search.value.toLowerCase());
  });
}

function write_row(body, tag) {
  tag.row = mark(body, 'tr', { class: tag.has_failed ? 'failed' : '', 'data-tag': tag.id });
  mark(mark(tag.row, 'th', { scope: 'row', title: tag.id }), 'a', { href: address(tag.id) }, tag.id);
  const shown = columns.filter(({ name }, n) => n && (tag.outcome === 'read' || name === 'attempts'));
  const lost = lost_of(tag), told = tag.outcome + (lost && `: ${lost} not read`);
  if (tag.outcome !== 'read') mark(tag.row, 'td', { colspan: columns.length - 1 - shown.length }, told);
  for (const { name, unit, key, text, is_aside } of shown) {
    const cell = is_aside ? { class: 'number aside', 'data-name': asides.length > 1 ? name : '' }
      : { class: 'number', 'data-name': name, 'data-unit': unit };
    mark(tag.row, 'td', cell, key(tag) === null ? '' : text(key(tag)));
  }
  tag.row.addEventListener('click', () => choose(tag));
}

function sort_table(key, sign) {
  const compare = (one, other) => {
    if (one.has_failed !== other.has_failed) return one.has_failed ? -1 : 1;
    const [a, b] = [one, other].map(key);
    if (a === b || a === null || b === null) return (a === null) - (b === null);
    return a < b ? -sign : sign;
  };
  document.querySelector('tbody').append(...[...tags_in_table].sort(compare).map(tag => tag.row));
}

// The charts

function nice_step(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map(each => each * power).find(each => each >= least * 0.999);
}

function ticks_of(low, high, step) {
  const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, n) => (first + n) * step);
}

// Returns the first and the last time of day in ms. It ends on the next day if midnight is within the readings.
function day_span() {
  const times = [...new Set(data.sensors.flatMap(({ lines }) => lines.flatMap(line => line.day.map(([at]) => at))))];
  times.sort((a, b) => a - b);
  const gaps = times.map((at, n) => (times[n + 1] ?? times[0] + DAY_SECONDS) - at), longest = Math.max(...gaps);
  if (longest < DAY_SECONDS / 4) return [0, DAY_MS];
  const last = times[gaps.indexOf(longest)], first = (last + longest) % DAY_SECONDS;
  return [first * 1000, (last < first ? last + DAY_SECONDS : last) * 1000];
}

function time_axis(width) {
  const is_wall = state.clock === 'wall', [first, last] = is_wall ? data.span_ms : day_span();
  const slack = Math.max((last - first) * 0.01, is_wall ? 250 : 300000);
  const [low, high] = [first - slack, last + slack], least = (high - low) / Math.max(width / (is_wall ? 64 : 40), 1);
  const step = WALL_STEPS_MS.find(each => each >= least) ?? Math.ceil(least / DAY_MS) * DAY_MS;
  const offset = is_wall ? new Date(first).getTimezoneOffset() * 60000 : 0;
  const ticks = ticks_of(low - offset, high - offset, step).map(at => at + offset);
  const wall_text = ms => step >= DAY_MS ? date(ms).slice(0, -5) : clock(ms).slice(0, step < 60000 ? 8 : 5);
  return {
    low, high, ticks: ticks.length < 2 ? [first, last] : ticks,
    halves: step === HOUR_MS ? ticks_of(low - offset, high - offset, step / 2).map(at => at + offset) : [],
    text: is_wall ? wall_text : ms => day_time(ms / 1000),
    ms_of: is_wall ? ms => first + ms : seconds => seconds * 1000 + (seconds * 1000 < first ? DAY_MS : 0),
  };
}

// The range of the colours if all values are in it, with some room at both ends.
function value_axis({ extent, limits, decimals }) {
  const [low, high] = extent[0] < limits[0] || extent[1] > limits[1] ? extent : limits;
  const room = Math.max(0.08 * (high - low), Math.abs(high) * 1e-6, 10 ** -decimals);
  const bottom = low - room, top = high + room, step = nice_step((top - bottom) / 7);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return { bottom, top, ticks: ticks_of(bottom, top, step), text: value => value.toFixed(digits) };
}

function draw_charts(is_again = false) {
  element('figures').replaceChildren();
  const figures = data.sensors.filter(sensor => sensor.lines.length).map(sensor => {
    const figure = mark(element('figures'), 'figure'), caption = mark(figure, 'figcaption');
    mark(caption, 'b', {}, sensor.label);
    return [sensor, mark(figure, 'div', { class: 'charting' }), mark(caption, 'span')];
  });
  // The heading is the first of the cells if they would not fill the last row.
  const columns = getComputedStyle(element('charts')).gridTemplateColumns.split(' ').length;
  element('charts').classList.toggle('first', figures.length % columns > 0);
  // After all figures are there, which changes their sizes. Their times are below each other.
  const charts = figures.map(([sensor, place, readout]) => {
    const size = size_of(place).map(each => Math.max(Math.floor(each), 120));
    return { sensor, place, readout, size, values: value_axis(sensor), labels: column_of(sensor, size[1]) };
  });
  const left = 10 + Math.max(...charts.flatMap(({ values }) => values.ticks.map(each => width_of(values.text(each)))));
  const beside = Math.max(...charts.map(({ labels }) => labels.width));
  for (const chart of charts) draw_chart(chart, left, chart.size[0] - beside);
  const unlabelled = document.querySelectorAll('.series .spare').length;
  const hint = unlabelled ? `; ${unlabelled} ${NO_ROOM}` : '';
  const line = `${is_line ? 'line' : 'point'} is a tag with its number`;
  const value = is_line ? 'last value' : 'value';
  const bold = document.querySelector('.marked') ? `; bold: the lowest and the highest ${value}` : '';
  const beside_others = document.querySelector('.beside')
    ? '; a point that would cover another is moved to the right' : '';
  const { offsetHeight } = element('lines');
  element('series').textContent = `Each ${line}${beside_others}${bold}${hint}.`;
  if (element('lines').offsetHeight !== offsetHeight && !is_again) draw_charts(true);  // in what room is left
  show_chosen();
}

function draw_chart({ sensor, place, readout, size: [width, height], values, labels }, left, right) {
  const times = time_axis(right - left);
  const start = left + (labels.count ? 0 : BESIDE_LONE);
  const x = at => start + (at - times.low) / (times.high - times.low) * (right - start);
  const y = value => 8 + (values.top - value) / (values.top - values.bottom) * (height - 34);
  const axis_name = state.clock === 'wall' ? 'wall time' : 'time of day in the greenhouse';
  const name = `${sensor.label} of ${sensor.lines.length} tags against ${axis_name}`;
  const svg = start_drawing(place, width, height, { role: 'img', 'aria-label': name });
  for (const value of values.ticks) {
    mark(svg, 'path', { class: 'grid', d: `M${left} ${y(value)}H${right}` });
    write(svg, left - 6, y(value) + 4, values.text(value), 'end');
  }
  for (const at of times.halves) mark(svg, 'path', { class: 'tick', d: `M${x(at)} ${y(values.bottom)}v3` });
  for (const at of times.ticks) {
    mark(svg, 'path', { class: 'tick', d: `M${x(at)} ${y(values.bottom)}v5` });
    write(svg, Math.min(x(at), width - width_of(times.text(at)) / 2), height - 8, times.text(at), 'middle');
  }
  const lone = [];
  const lines = sensor.lines.map(line => {
    const tag = data.tags[line.tag], points = line[state.clock].map(([offset, value, low = value, high = value]) => {
      const at = times.ms_of(offset);
      return { tag, at, value, low, high, x: x(at), y: y(value), y_low: y(low), y_high: y(high) };
    }).sort((one, other) => one.at - other.at);
    if (points.length === 1) {  // beside those that it would cover
      const [point] = points, is_near = p => Math.abs(p.from - point.x) < 3 && Math.abs(p.y - point.y) < APART;
      const other = lone.findLast(is_near);
      point.from = point.x;
      if (other) point.x = other.x + APART;
      lone.push(point);
      if (other) svg.classList.add('beside');
    }
    const is_bold = is_marked(sensor, tag);
    return { points, text: end_text(sensor, tag), is_bold, group: draw_line(svg, tag, points, is_bold) };
  });
  lines.sort((one, other) => other.is_bold - one.is_bold);  // which have labels first
  label_lines(lines, [left + FROM_AXIS, 0, labels.count ? right + 6 : width, y(values.bottom)], labels, right + 14);
  const points = lines.flatMap(line => line.points), point_at = event => nearest(points, svg, event, 40);
  place.addEventListener('pointermove', event => { readout.textContent = readout_of(sensor, point_at(event)); });
  place.addEventListener('pointerleave', () => { readout.textContent = ''; });
  place.addEventListener('click', event => choose(point_at(event)?.tag));
}

// The text at the end of a line: of the lowest and the highest value, with this value.
const is_marked = (sensor, tag) => sensor.extremes.length > 1 && is_extreme(sensor, tag);
const end_text = (sensor, tag) =>
  is_marked(sensor, tag) ? `${tag.id}: ${tag.values[data.sensors.indexOf(sensor)].toFixed(sensor.decimals)}` : tag.id;

function draw_line(svg, tag, points, is_bold) {
  const group = mark(svg, 'g', { class: is_bold ? 'series marked' : 'series', 'data-tag': tag.id });
  const runs = runs_of(points).filter(run => run.length > 1);
  for (const run of runs.filter(each => each.some(p => p.low < p.high))) {
    const band = [...run.map(p => [p.x, p.y_high]), ...run.map(p => [p.x, p.y_low]).reverse()];
    mark(group, 'path', { class: 'band', d: path_of(band) });
  }
  for (const run of runs) mark(group, 'path', { d: path_of(run.map(p => [p.x, p.y])) });
  if (points.length < 30) points.forEach(p => mark(group, 'circle', { cx: p.x, cy: p.y, r: 3 }));
  return group;
}

// Returns the points of a line in pieces: a gap of many times the usual distance has no line.
function runs_of(points) {
  const gaps = points.slice(1).map((p, n) => p.at - points[n].at).sort((a, b) => a - b);
  const longest = 8 * (gaps[Math.floor(gaps.length / 2)] ?? 0), runs = [];
  points.forEach((point, n) => {
    if (!n || point.at - points[n - 1].at > longest) runs.push([]);
    runs.at(-1).push(point);
  });
  return runs;
}

// Returns the room for the labels at the ends of the lines, which stand in several columns if they are many.
function column_of(sensor, height) {
  const lines = sensor.lines.filter(line => line[state.clock].length > 1);
  const texts = lines.map(line => end_text(sensor, data.tags[line.tag]));
  const count = texts.length > MOST_LABELLED ? 1 : Math.ceil(texts.length * LINE_STEP / (height - 34));
  const widest = Math.min(Math.max(...texts.map(width_of), 14), 80) + 6;
  return { count, widest, width: count ? 14 + count * widest : BESIDE_LONE, low: 8, high: height - 26 };
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

// Labels the end of each line at the right, and each point of a tag that has only one beside it.
function label_lines(lines, room, { count, widest, low, high }, column) {
  const route = [], taken = lines.flatMap(line => line.points.map(p => around(p.x, p.y, 6, 6)));
  const ends = lines.filter(line => line.points.length > 1).map(line => ({ ...line, ...line.points.at(-1) }))
    .sort((one, other) => one.y - other.y);
  const is_spare = ends.length > MOST_LABELLED;
  spread(ends.map(end => end.y), LINE_STEP / count, low, high).forEach((y, number) => {
    const end = ends[number], left = column + number % count * widest + 3;
    const width = width_of(end.text), box = around(left + width / 2, is_spare ? end.y : y, width, TEXT_HEIGHT);
    taken.push(box);
    if (!is_spare) draw_leader(end.group, end.x + 2, end.y, left - 3, y);
    write_in(end.group, box, is_spare ? 'halo spare' : 'halo', end.text);
  });
  const lone = lines.filter(({ points }) => points.length === 1).map(({ group, text, is_bold, points: [{ x, y }] }) =>
    ({ group, text, label: { x, y, radius: is_bold ? 4 : 2, outer: 3, width: width_of(text) + 3 } }));
  const boxes = { taken, room, route, dots: lone.map(({ label }) => label) };
  plan_labels(lone.map(({ label }) => label), boxes);
  for (const { group, text, label } of lone) label_dot(group, label, boxes, 'halo', text);
}

function readout_of(sensor, point) {
  if (!point) return '';
  const { tag, at, value, low, high } = point, time = state.clock === 'wall' ? clock(at) : day_time(at / 1000);
  const range = low < high ? ` (${low.toFixed(sensor.decimals)} to ${high.toFixed(sensor.decimals)})` : '';
  return `tag ${tag.id}, ${time}: ${with_unit(sensor, value)}${range}`;
}

// The chosen tag

const chosen_tag = () => data.tags.find(({ id }) => [address(id), `#tag=${id}`].includes(location.hash));

function choose(tag) {
  if (tag) location.hash = address(tag.id);
  else history.replaceState(null, '', location.pathname);
  show_chosen();
}

function show_chosen() {
  const tag = chosen_tag(), focused = document.activeElement;
  write_pieces(element('facts'), tag ? facts_of(tag) : []);
  for (const each of document.querySelectorAll('[data-tag]')) {
    const is_chosen = each.dataset.tag === tag?.id;
    each.classList.toggle('chosen', is_chosen);
    each.ariaCurrent = is_chosen ? 'true' : null;
    if (is_chosen && each.localName !== 'tr' && each.nextSibling) each.parentNode.append(each);  // above the others
  }
  const dots = [...document.querySelectorAll('#map a')];
  const current = dots.find(dot => dot.dataset.tag === tag?.id) ?? dots[0];
  for (const dot of dots) dot.setAttribute('tabindex', dot === current ? 0 : -1);
  if (dots.includes(focused)) focused.focus({ preventScroll: true });  // it was moved
}

element('map').addEventListener('keydown', event => {
  const step = KEY_STEPS[event.key], focused = document.activeElement.dataset.tag;
  if (!step) return;
  event.preventDefault();
  const here = placed_tags.findIndex(tag => tag.id === focused);
  choose(placed_tags[(here + step + placed_tags.length) % placed_tags.length]);
  document.querySelector('#map a.chosen')?.focus();
});
element('tabs').addEventListener('keydown', event => {
  if (!KEY_STEPS[event.key]) return;
  event.preventDefault();
  pick(state.sensor + KEY_STEPS[event.key]);
  element('tabs').children[state.sensor].focus();
});
document.addEventListener('keydown', event => { if (event.key === 'Escape') choose(); });
document.querySelector('#chosen button').addEventListener('click', () => choose());
for (const each of document.querySelectorAll('[name=clock]')) {
  each.checked = each.value === state.clock;
  each.addEventListener('change', () => {
    state.clock = each.value;
    draw_charts();
  });
}

// Gaps are equal, and names of two words take two lines in the head of the table only if they must.
function fit_table() {
  const table = document.querySelector('table'), frame = table.parentNode;
  table.classList.remove('narrow');
  table.style = 'width: max-content';
  const spare = frame.clientWidth - table.getBoundingClientRect().width;
  table.style = `--gap: ${Math.max(Math.floor(spare / (columns.length - 1)), 0)}px`;
  table.classList.toggle('narrow', spare < 0);
}

function draw_all() {
  fit_table();
  draw_map();
  draw_charts();
}

const page_style = document.documentElement.style;
page_style.setProperty('--colours', data.colours);
page_style.setProperty('--aspect', aspect);
page_style.setProperty('--sensors', data.sensors.length);
document.body.classList.toggle('tall', aspect < 1);
document.body.classList.toggle('lone', data.sensors.length === 1);
document.querySelector('#failed b').textContent = failure_words.length > 1 ? 'not read' : failure_words[0];
element('charts').classList.toggle('long', is_long);
element('bins').hidden = !data.is_binned;
element('failed').hidden = !failure_words.length;
element('moments').hidden = !data.is_of_several_times;
element('tables').hidden = !data.tables.length;
element('route').hidden = data.route.length < 2;
element('stops').hidden = !data.stops.length;
const has_blanks = tags_in_table.some(tag => !tag.has_failed && tag.values.includes(null));
element('blanks').hidden = !(data.is_complete && has_blanks);
element('goals').hidden = !placed_tags.some(tag => tag.goal);
if (!is_line) document.querySelector('#charts h2').textContent = 'When each tag was read';
element('zone').textContent = `wall time (${zone})`;
element('charts').hidden = !data.sensors.length || data.span_ms[1] - data.span_ms[0] <= ONE_MOMENT_MS;
write_head();
write_table();
fit_table();
data.sensors.forEach(draw_tab);
if (data.sensors.length) pick(0);
else draw_map();
draw_charts();
addEventListener('hashchange', show_chosen);
const widths = () => `${innerWidth} ${element('map').clientWidth}`;
let drawn_widths = widths();
addEventListener('resize', () => {
  if (drawn_widths === widths()) return;
  drawn_widths = widths();
  draw_all();
});
// The header of the table stays while the page scrolls.
addEventListener('scroll', () => {
  const head = document.querySelector('thead'), { top, height } = head.parentNode.getBoundingClientRect();
  head.style.transform = `translateY(${clamp(-top, 0, Math.max(height - 2 * head.offsetHeight, 0))}px)`;
}, { passive: true });
