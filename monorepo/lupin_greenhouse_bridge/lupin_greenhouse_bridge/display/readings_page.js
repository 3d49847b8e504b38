// Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
'use strict';
// Draws the page of readings from the data in it. The chosen tag is the fragment of the address: #tag=28.
const data = JSON.parse(document.getElementById('data').textContent);
const PAPER = { map: [440, 740], tab: [104, 158], chart: [222, 165] };  // pixels in print
const MOST_LABELLED = 100;  // lines of a chart; of more, only the chosen one has a label
const LINES = 'Each line is a tag with its number';
const POINTS = 'Each point is a reading of another tag, so values differ by place as well as by time';
const TEXT_HEIGHT = 13;
const DAY_SECONDS = 86400;
const ARROW = 'M5 0L-4 -3.5L-4 3.5Z';
const element = id => document.getElementById(id);
data.tags.forEach((tag, number) => { tag.number = number; });
const tags_by_id = new Map(data.tags.map(tag => [tag.id, tag]));
const placed_tags = data.tags.filter(tag => tag.x !== null);
const state = { sensor: 0, clock: 'wall', sort: null, is_descending: false, is_printed: false };
const pen = document.createElement('canvas').getContext('2d');
pen.font = '11px system-ui, sans-serif';

const add = (parent, name, text = '', className = '') => {
  const child = parent.appendChild(document.createElement(name));
  child.textContent = text;
  if (className) child.className = className;
  return child;
};
const draw = (parent, name, attributes = {}, text = '') => {
  const child = parent.appendChild(document.createElementNS('http://www.w3.org/2000/svg', name));
  for (const [key, value] of Object.entries(attributes)) child.setAttribute(key, value);
  if (text) child.textContent = text;
  return child;
};
const drawing = (parent, width, height, more) => {
  parent.replaceChildren();
  return draw(parent, 'svg', { width, height, viewBox: `0 0 ${width} ${height}`, ...more });
};
// Writes texts with a dot between them: a line never ends with it.
const pieces = (place, texts, is_bad = () => false) => {
  place.replaceChildren();
  place.classList.toggle('pieces', texts.length > 0);
  texts.forEach((text, number) => {
    const piece = add(place, 'span');
    add(piece, 'i', number ? ' · ' : '');
    add(piece, 'span', text, is_bad(number) ? 'bad' : '');
  });
};
const write = (svg, x, y, text, anchor = 'start') =>
  draw(svg, 'text', { class: 'muted', x, y, 'text-anchor': anchor }, text);
const width_of = text => pen.measureText(text).width;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const grouped = number => number.toLocaleString('en');
const short = (number, digits) => String(Number(number.toPrecision(digits)));
const pad = number => String(number).padStart(2, '0');
const clock = ms => new Date(ms).toTimeString().slice(0, 8);
const date = ms => new Date(ms).toLocaleDateString('en-GB', { day: 'numeric', month: 'short', year: 'numeric' });
const day_time = seconds => `${pad(Math.floor(seconds / 3600))}:${pad(Math.floor(seconds / 60) % 60)}`;
const written = (sensor, value) => value.toFixed(sensor.decimals);
const with_unit = (sensor, value) => `${written(sensor, value)} ${sensor.unit}`.trim();
const address = tag => `#tag=${encodeURIComponent(tag.id)}`;
const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
// If all failures have the same word, it stands in the key and not beside each tag.
const failure_words = [...new Set(data.tags.filter(tag => tag.has_failed).map(tag => tag.outcome))];
const is_one_day = new Set(data.span_ms.map(date)).size <= 1;

function chosen_tag() {
  try {
    return tags_by_id.get(decodeURIComponent(location.hash.replace(/^#tag=/, '')));
  } catch {
    return undefined;  // not an address of ours
  }
}

function choose(tag) {
  if (tag) location.hash = address(tag);
  else {
    history.replaceState(null, '', location.pathname + location.search);
    show_chosen();
  }
}

// The head

function write_head() {
  document.title = `Readings of ${data.title}`;
  const parts = [`${grouped(data.read_count)} of ${grouped(data.tag_count)} tags read`];
  parts.push(...data.counts.map(([word, count]) => `${grouped(count)} ${word}`));
  if (data.span_ms.length) {
    const [from, to] = data.span_ms.map(ms => `${is_one_day ? '' : `${date(ms)} `}${clock(ms)}`);
    parts.push(from === to ? from : `${from} to ${to} (${data.duration})`, data.greenhouse_times);
  }
  pieces(document.querySelector('h1'), parts, number => data.counts[number - 1]?.[2]);
  const day = is_one_day && data.span_ms.length ? date(data.span_ms[0]) : '';
  pieces(element('file'), [data.title, day, `times in ${zone}`, data.speed].filter(Boolean));
  data.failures.forEach(write_failure);
  data.notes.forEach(note => add(element('notes'), 'p', note));
}

function write_failure({ word, reason, tags, count }) {
  const line = add(element('failures'), 'li');
  line.append(count > 1 ? 'Tags ' : 'Tag ');
  tags.forEach((number, place) => {
    if (place) line.append(place + 1 < count ? ', ' : ' and ');
    add(line, 'a', data.tags[number].id).href = address(data.tags[number]);
  });
  if (count > tags.length) line.append(` and ${grouped(count - tags.length)} more`);
  line.append(' ');
  add(line, 'span', word, 'bad');
  if (reason) line.append(`: ${reason}`);
}

// Boxes [left, top, right, bottom] and the places of labels

const around = (x, y, width, height) => [x - width / 2, y - height / 2, x + width / 2, y + height / 2];
const common = (a, b) => Math.max(Math.min(a[2], b[2]) - Math.max(a[0], b[0]), 0)
  * Math.max(Math.min(a[3], b[3]) - Math.max(a[1], b[1]), 0);

// Returns the box beside a dot in which a label covers least, how much it covers there, and whether it
// is so far from the dot that it needs a line. A label may cross the `route`, if it must.
function place_label(x, y, radius, width, { taken, room, route = [], most_places = Infinity }) {
  const aside = radius + width / 2 + 4, above = radius + TEXT_HEIGHT / 2 + 1;
  const mirrored = (dx, dy) => [[dx, dy], [-dx, dy], [dx, -dy], [-dx, -dy]];
  const cross = (dx, dy) => [[dx, 0], [-dx, 0], [0, -dy], [0, dy]];
  const near = [...cross(aside, above), ...mirrored(aside / 2, -above), ...mirrored(aside, 0.75 * above)];
  const far = [...cross(aside + 14, 2.2 * above), ...mirrored(aside + 6, 1.7 * above)];
  const reach = around(x, y, 4 * aside + width, 6 * above + TEXT_HEIGHT);
  const [boxes, steps] = [taken, route].map(each => each.filter(box => common(reach, box) > 0));
  const shared_with = (box, others) => others.reduce((sum, other) => sum + common(box, other), 0);
  let best = { cost: Infinity };
  [...near, ...far].slice(0, most_places).forEach(([dx, dy], number) => {
    const box = around(x + dx, y + dy, width, TEXT_HEIGHT), area = width * TEXT_HEIGHT;
    const covered = shared_with(box, boxes), outside = area - common(box, room);
    const cost = covered + 5 * shared_with(box, steps) + 2 * outside + number * 0.01 * area;
    if (cost < best.cost) best = { box, cost, covered, outside, is_far: number >= near.length };
  });
  return best;
}

const write_label = (parent, box, className, text = '') =>
  draw(parent, 'text', { class: className, x: (box[0] + box[2]) / 2, y: box[3] - 3, 'text-anchor': 'middle' }, text);
const draw_leader = (parent, x, y, [left, top, right, bottom]) =>
  draw(parent, 'line', { class: 'leader', x1: x, y1: y, x2: clamp(x, left, right), y2: clamp(y, top, bottom) });

// The map

const view = (() => {
  const corners = [data.walls, ...data.tables].flatMap(box => [box.slice(0, 2), box.slice(2)]);
  const points = [...corners, ...data.route, ...placed_tags.map(tag => [tag.x, tag.y])];
  const [x0, y0] = [0, 1].map(axis => points.reduce((least, point) => Math.min(least, point[axis]), Infinity));
  const [x1, y1] = [0, 1].map(axis => points.reduce((most, point) => Math.max(most, point[axis]), -Infinity));
  return { x0, y0, x1, y1, width: x1 - x0, height: y1 - y0 };
})();

function frame_of(width, height, margin) {
  const inner_width = width - margin.left - margin.right;
  const fitting = Math.min(inner_width / view.width, (height - margin.top - margin.bottom) / view.height);
  const scale = Math.max(fitting, 1e-6), high = view.height * scale;
  return {
    scale, width: Math.max(width, 1), height: high + margin.top + margin.bottom,
    x: x => margin.left + (inner_width - view.width * scale) / 2 + (x - view.x0) * scale,
    y: y => margin.top + high - (y - view.y0) * scale,
  };
}

function draw_ground(svg, { x, y, scale }) {
  const box = ([x0, y0, x1, y1], name) => draw(svg, 'rect', {
    class: name, x: x(x0), y: y(y1), width: (x1 - x0) * scale, height: (y1 - y0) * scale,
  });
  box(data.walls, 'wall');
  data.tables.forEach(corners => box(corners, 'bench'));
}

function draw_route(svg, { x, y }) {
  if (data.route.length < 2) return;
  draw(svg, 'path', { class: 'route', d: path_of(data.route.map(point => [x(point[0]), y(point[1])])) });
  for (const [at_x, at_y, heading] of data.arrows) {
    const turn = `translate(${x(at_x)} ${y(at_y)}) rotate(${-heading * 180 / Math.PI})`;
    draw(svg, 'path', { class: 'arrow', d: ARROW, transform: turn });
  }
  const [start, end] = [data.route[0], data.route.at(-1)].map(point => [x(point[0]), y(point[1])]);
  draw(svg, 'circle', { class: 'end', cx: start[0], cy: start[1], r: 4.5 });
  draw(svg, 'rect', { class: 'end', x: end[0] - 4, y: end[1] - 4, width: 8, height: 8 });
}

function draw_map() {
  const place = element('map'), number = state.sensor, sensor = data.sensors[number];
  const free_height = innerHeight - place.getBoundingClientRect().top - scrollY - 62;
  const on_screen = [place.clientWidth, innerWidth < 704 ? Infinity : Math.max(free_height, 460)];
  const frame = frame_of(...state.is_printed ? PAPER.map : on_screen, { left: 40, right: 12, top: 6, bottom: 34 });
  const name = 'Map of the greenhouse. The arrow keys choose the next tag.';
  const svg = drawing(place, frame.width, frame.height, { role: 'group', 'aria-label': name });
  const room = [frame.x(view.x0), frame.y(view.y1), frame.x(view.x1), frame.y(view.y0)];
  draw_axes(svg, frame, room);
  draw_ground(svg, frame);
  draw_route(svg, frame);
  const value_of = tag => tag.values[number] ?? null;
  const extremes = new Set(sensor?.extremes.flatMap(([, numbers]) => numbers.map(each => data.tags[each])));
  const largest = clamp(data.closest_m * frame.scale / 2 - 1, 2.5, 9);  // the closest dots do not touch
  const dots = placed_tags.map(tag => {
    const is_large = tag.has_failed || value_of(tag) !== null;
    const radius = is_large ? largest : Math.min(largest, 4.5), ringed = radius + (extremes.has(tag) ? 3 : 0);
    return { tag, x: frame.x(tag.x), y: frame.y(tag.y), radius, ringed, urgency: is_large + tag.has_failed };
  });
  const boxes = {
    taken: dots.map(({ x, y, ringed }) => around(x, y, 2 * ringed, 2 * ringed)), room,
    route: data.route_steps.map(([x, y]) => around(frame.x(x), frame.y(y), 4, 4)),
  };
  for (const [word, [x, y]] of Object.entries(data.route_ends)) {
    const { box } = place_label(frame.x(x), frame.y(y), 5, width_of(word) + 16, boxes);
    boxes.taken.push(around(frame.x(x), frame.y(y), 10, 10), box);
    write_label(svg, box, 'muted halo', word);
  }
  const leaders = draw(svg, 'g');
  dots.sort((one, other) => other.urgency - one.urgency);
  for (const dot of dots) draw_tag(svg, leaders, dot, value_of(dot.tag), boxes);
  write_key();
  show_chosen();
}

function draw_tag(svg, leaders, { tag, x, y, radius, ringed, urgency }, value, boxes) {
  const group = draw(svg, 'a', { href: address(tag), 'data-tag': tag.id, tabindex: -1 });
  group.classList.toggle('failed', tag.has_failed);
  const circle = (className, r, more) => draw(group, 'circle', { class: className, cx: x, cy: y, r, ...more });
  draw(group, 'title', {}, hover_of(tag));  // its name for a screen reader, too
  if (ringed > radius) circle('extreme', ringed);
  circle('ring', radius + 3);
  if (value === null) circle('dot empty', radius);
  else circle('dot', radius, { fill: data.sensors[state.sensor].colours[tag.number] });
  if (tag.has_failed) draw(group, 'path', { class: 'cross', d: cross_at(x, y, radius / 2) });
  const text = label_of(tag, value), width = width_of(tag.id + text) + Math.min(tag.id.length, 12) + 6;
  const { box, covered, is_far } = place_label(x, y, ringed, width, boxes);
  if (covered > 0.12 * width * TEXT_HEIGHT) return;
  boxes.taken.push(box);
  if (is_far) draw_leader(leaders, x, y, box);
  const label = write_label(group, box, urgency ? 'halo' : 'muted halo');
  draw(label, 'tspan', { class: urgency ? 'id' : '' }, tag.id);
  if (text) draw(label, 'tspan', {}, text);
}

function label_of(tag, value) {
  if (tag.has_failed) return failure_words.length > 1 ? ` ${tag.outcome}` : '';
  if (value === null) return '';
  const sensor = data.sensors[state.sensor], [low, high] = sensor.limits;
  return `: ${written(sensor, value)}${value > high ? ' ▲' : value < low ? ' ▼' : ''}`;
}

const cross_at = (x, y, arm) => `M${x - arm} ${y - arm}l${2 * arm} ${2 * arm}m${-2 * arm} 0l${2 * arm} ${-2 * arm}`;

function draw_axes(svg, frame, [left, top, right, bottom]) {
  const step = nice_step(60 / frame.scale);
  for (const x of ticks_of(view.x0, view.x1, step)) write(svg, frame.x(x), bottom + 15, short(x, 6), 'middle');
  for (const y of ticks_of(view.y0, view.y1, step)) write(svg, left - 7, frame.y(y) + 4, short(y, 6), 'end');
  write(svg, (left + right) / 2, bottom + 30, 'x (m)', 'middle');
  const turned = draw(svg, 'g', { transform: `translate(${left - 30} ${(top + bottom) / 2}) rotate(-90)` });
  write(turned, 0, 0, 'y (m)', 'middle');
}

function write_key() {
  const sensor = data.sensors[state.sensor], [low, high] = sensor?.limits ?? [];
  document.querySelector('#scale p').hidden = !sensor;
  if (sensor) {
    element('low').textContent = short(low, 4);
    element('high').textContent = `${short(high, 4)} ${sensor.unit}`;
    document.querySelector('#scale .colours').ariaLabel = `Colours from ${low} to ${high} ${sensor.unit}`;
  }
  const values = data.tags.map(tag => tag.values[state.sensor]).filter(value => value !== null);
  const outside = values.filter(value => value < low || value > high).length;
  element('outside').textContent = outside ? `▲ above, ▼ below the scale: ${outside}` : '';
  element('without').textContent = sensor ? `no ${sensor.name}` : 'tag';
}

// The tabs: a small map of each sensor

function draw_tabs() {
  element('tabs').replaceChildren();
  const tabs = data.sensors.map(() => add(element('tabs'), 'button'));  // all, before one is measured
  tabs.forEach((tab, number) => draw_tab(tab, data.sensors[number], number));
  mark_tab();
}

function draw_tab(tab, sensor, number) {
  tab.type = 'button';
  tab.setAttribute('role', 'tab');
  tab.setAttribute('aria-controls', 'panel');
  tab.addEventListener('click', () => pick(number));
  add(tab, 'b', sensor.name);
  const size = state.is_printed ? PAPER.tab : [Math.max(tab.clientWidth - 12, 20), 170];
  const frame = frame_of(...size, { left: 2, right: 2, top: 2, bottom: 2 });
  const svg = draw(tab, 'svg', { width: frame.width, height: frame.height, 'aria-hidden': true });
  draw_ground(svg, frame);
  const r = clamp(frame.scale * 0.22, 1.5, 6);
  for (const tag of placed_tags) {
    const [cx, cy] = [frame.x(tag.x), frame.y(tag.y)], fill = sensor.colours[tag.number];
    if (tag.has_failed) draw(svg, 'path', { class: 'cross thin', d: cross_at(cx, cy, r * 0.8) });
    else if (fill) draw(svg, 'circle', { cx, cy, r, fill, stroke: 'currentColor', 'stroke-width': 0.7 });
  }
  add(tab, 'span', sensor.value_range);
  if (state.is_printed) {
    const [low, high] = sensor.limits.map(each => short(each, 3)), key = add(tab, 'span', `${low} `, 'key');
    add(key, 'i', '', 'colours');
    key.append(` ${high}`);
  }
  const unbroken = text => text.replace(/ (?=\S+ at )/, '\u00a0');
  for (const [text] of sensor.extremes) add(tab, 'span', unbroken(text), 'extremes');  // on paper
}

function mark_tab() {
  [...element('tabs').children].forEach((tab, n) => {
    tab.setAttribute('aria-selected', n === state.sensor);
    tab.tabIndex = n === state.sensor ? 0 : -1;
  });
  const sensor = data.sensors[state.sensor];
  element('shown').textContent = sensor ? sensor.label : 'No tag was read';
  pieces(element('extremes'), (sensor?.extremes ?? []).map(([text], n) => n ? text : `ringed: ${text}`));
}

function pick(number) {
  state.sensor = (number + data.sensors.length) % data.sensors.length;
  mark_tab();
  draw_map();
}

// The table

const named_value = (sensor, value) => `${sensor.name} ${with_unit(sensor, value)}`;
const facts_of = tag => [
  `tag ${tag.id}: ${tag.outcome}${tag.reason ? ` (${tag.reason})` : ''}`,
  ...tag.values.map((value, n) => value === null ? '' : named_value(data.sensors[n], value)),
  tag.stamp_ms === null ? '' : `${clock(tag.stamp_ms)} (greenhouse ${day_time(tag.time_of_day)})`,
  tag.attempts > 1 ? `${tag.attempts} attempts` : '',
].filter(Boolean);
const hover_of = tag => facts_of(tag).join(' · ');

const dates = new Set(data.tags.filter(tag => tag.stamp_ms !== null).map(tag => date(tag.stamp_ms)));
const has_attempts = data.tags.some(tag => tag.attempts > 1);
const time_in_table = ms => dates.size > 1 ? `${date(ms)} ${clock(ms)}` : clock(ms);
// What a column shows, and by what it sorts. A failed tag has its reason in place of the numbers.
const columns = [
  { name: 'tag', key: tag => tag.number },
  { name: 'outcome', key: tag => tag.outcome },
  ...data.sensors.map((sensor, n) => ({
    name: sensor.name, unit: sensor.unit, key: tag => tag.values[n], text: value => written(sensor, value),
  })),
  { name: 'time', unit: dates.size > 1 ? '' : [...dates].join(), key: tag => tag.stamp_ms, text: time_in_table },
  { name: 'greenhouse', unit: 'time of day', key: tag => tag.time_of_day, text: day_time },
  ...has_attempts ? [{ name: 'attempts', key: tag => tag.attempts, text: String }] : [],
];

function write_table() {
  const table = document.querySelector('table'), head = add(add(table, 'thead'), 'tr');
  columns.forEach((column, number) => {
    const cell = add(head, 'th', '', column.text ? 'number' : '');
    cell.scope = 'col';
    const button = add(cell, 'button', column.name);
    button.type = 'button';
    if (column.unit) add(cell, 'small', column.unit);
    button.addEventListener('click', () => {
      state.is_descending = state.sort === number && !state.is_descending;
      state.sort = number;
      [...head.children].forEach(each => each.removeAttribute('aria-sort'));
      cell.setAttribute('aria-sort', state.is_descending ? 'descending' : 'ascending');
      sort_table();
    });
  });
  const body = add(table, 'tbody');
  data.tags.forEach(tag => write_row(body, tag));
  const search = document.querySelector('input[type=search]');
  search.hidden = data.tags.length <= 50;
  search.addEventListener('input', () => {
    for (const tag of data.tags) tag.row.hidden = !tag.id.toLowerCase().includes(search.value.toLowerCase());
  });
}

function write_row(body, tag) {
  tag.row = add(body, 'tr', '', tag.has_failed ? 'failed' : '');
  const first = add(tag.row, 'th');
  first.scope = 'row';
  first.title = tag.id;
  add(first, 'a', tag.id).href = address(tag);
  add(tag.row, 'td', tag.outcome);
  if (tag.has_failed) {
    const cell = add(tag.row, 'td', '', 'reason');
    cell.colSpan = data.sensors.length + 2;
    add(cell, 'div', tag.reason);
  }
  for (const { key, text } of columns.slice(tag.has_failed ? data.sensors.length + 4 : 2)) {
    add(tag.row, 'td', key(tag) === null ? '' : text(key(tag)), 'number');
  }
  tag.row.addEventListener('click', () => choose(tag));
}

function sort_table() {
  const { key } = columns[state.sort], sign = state.is_descending ? -1 : 1;
  const compare = (one, other) => {
    if (one.has_failed !== other.has_failed) return one.has_failed ? -1 : 1;
    const [a, b] = [one, other].map(key);
    if (a === b || a === null || b === null) return (a === null) - (b === null) || one.number - other.number;
    return a < b ? -sign : sign;
  };
  document.querySelector('tbody').append(...[...data.tags].sort(compare).map(tag => tag.row));
}

// The charts

const nice_step = least => {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map(each => each * power).find(each => each >= least * 0.999);
};
const ticks_of = (low, high, step) => {
  const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, n) => (first + n) * step);
};
const WALL_STEPS_MS = [
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, DAY_SECONDS,
].map(seconds => seconds * 1000);
const DAY_MS = DAY_SECONDS * 1000;

function wall_axis(width) {
  const [first, last] = data.span_ms, slack = Math.max((last - first) * 0.01, 250);
  const [low, high] = [first - slack, last + slack], least = (high - low) / Math.max(width / 64, 1);
  const step = WALL_STEPS_MS.find(each => each >= least) ?? Math.ceil(least / DAY_MS) * DAY_MS;
  const offset = new Date(first).getTimezoneOffset() * 60000;
  const ticks = ticks_of(low - offset, high - offset, step).map(at => at + offset);
  const text = ms => step >= DAY_MS ? date(ms).slice(0, -5) : clock(ms).slice(0, step < 60000 ? 8 : 5);
  return { low, high, ticks: ticks.length < 2 ? [first, last] : ticks, text, start: first };
}

function day_axis(width) {
  const ticks = ticks_of(0, DAY_SECONDS, width < 330 ? 21600 : 10800);
  return { low: 0, high: DAY_SECONDS, ticks, text: day_time, start: 0 };
}

// Returns the ticks of the values, and with how many decimals they are written.
function value_axis(sensor, height) {
  const [least, greatest] = sensor.extent;
  const least_step = Math.max((greatest - least) / (height / 40), Math.abs(greatest) * 1e-6, 10 ** -sensor.decimals);
  const step = nice_step(least_step), spare = least === greatest ? 1 : 0;
  const bottom = (Math.floor(least / step) - spare) * step, top = (Math.ceil(greatest / step) + spare) * step;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return { bottom, top, ticks: ticks_of(bottom, top, step), text: value => value.toFixed(decimals) };
}

function draw_charts() {
  element('figures').replaceChildren();
  const figures = data.sensors.filter(sensor => sensor.lines.length).map(sensor => {
    const figure = add(element('figures'), 'figure'), caption = add(figure, 'figcaption');
    add(caption, 'b', sensor.label);
    return [sensor, add(figure, 'div', '', 'charting'), add(caption, 'span')];  // all, before one is measured
  });
  figures.forEach(([sensor, place, readout]) => draw_chart(sensor, place, readout));
  const is_line = data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > 1));
  const axis = state.is_printed ? `; time in ${state.clock === 'wall' ? zone : 'the greenhouse'}` : '';
  element('series').textContent = `${is_line ? LINES : POINTS}${axis}.`;
  show_chosen();
}

function draw_chart(sensor, place, readout) {
  const [width, height] = state.is_printed ? PAPER.chart : [Math.max(place.clientWidth, 120), 220];
  const values = value_axis(sensor, height);
  const left = 10 + Math.max(...values.ticks.map(each => width_of(values.text(each)))), right = width - 34;
  const times = (state.clock === 'wall' ? wall_axis : day_axis)(right - left);
  const x = at => left + (at - times.low) / (times.high - times.low) * (right - left);
  const y = value => 8 + (values.top - value) / (values.top - values.bottom) * (height - 34);
  const axis_name = state.clock === 'wall' ? 'wall time' : 'time of day in the greenhouse';
  const name = `${sensor.label} of ${sensor.lines.length} tags against ${axis_name}`;
  const svg = drawing(place, width, height, { role: 'img', 'aria-label': name });
  for (const value of values.ticks) {
    draw(svg, 'path', { class: 'grid', d: `M${left} ${y(value)}H${right}` });
    write(svg, left - 6, y(value) + 4, values.text(value), 'end');
  }
  for (const at of times.ticks) {
    draw(svg, 'path', { class: 'grid', d: `M${x(at)} ${y(values.bottom)}v4` });
    write(svg, x(at), height - 8, times.text(at), 'middle');
  }
  const lines = sensor.lines.map(line => {
    const tag = data.tags[line.tag], points = line[state.clock].map(([offset, value, low, high]) => {
      const at = times.start + offset;
      return { tag, at, value, low, high, x: x(at), y: y(value), y_low: y(low ?? value), y_high: y(high ?? value) };
    });
    return { points, group: draw_line(svg, tag, points) };
  });
  const points = lines.flatMap(line => line.points);
  label_lines(lines, points, [left, 0, width, y(values.bottom) + 8]);
  const nearest = event => {
    const corner = svg.getBoundingClientRect();
    const distance = p => Math.hypot(p.x - event.clientX + corner.left, p.y - event.clientY + corner.top);
    return points.reduce((best, p) => distance(p) < (best ? distance(best) : 40) ? p : best, null);
  };
  place.addEventListener('pointermove', event => { readout.textContent = readout_of(sensor, nearest(event)); });
  place.addEventListener('pointerleave', () => { readout.textContent = ''; });
  place.addEventListener('click', event => choose(nearest(event)?.tag));
}

function draw_line(svg, tag, points) {
  const group = draw(svg, 'g', { class: points.length > 1 ? 'series line' : 'series', 'data-tag': tag.id });
  const runs = runs_of(points).filter(run => run.length > 1);
  for (const run of runs.filter(each => each.some(p => p.low !== undefined))) {
    const band = [...run.map(p => [p.x, p.y_high]), ...run.map(p => [p.x, p.y_low]).reverse()];
    draw(group, 'path', { class: 'band', d: path_of(band) });
  }
  for (const run of runs) draw(group, 'path', { d: path_of(run.map(p => [p.x, p.y])) });
  if (points.length < 30) points.forEach(p => draw(group, 'circle', { cx: p.x, cy: p.y, r: 2.5 }));
  return group;
}

// Labels the last point of each line. A label without a free place is shown if its tag is chosen.
function label_lines(lines, points, room) {
  const taken = points.map(p => around(p.x, p.y, 5, 5)), shown = lines.filter(line => line.points.length);
  for (const { group, points } of shown) {
    const { tag, x, y } = points.at(-1), most_places = points.length > 1 ? 1 : Infinity;
    const { box, covered, outside, is_far } = place_label(x, y, 1, width_of(tag.id), { taken, room, most_places });
    const is_free = shown.length <= MOST_LABELLED && covered + outside < 1;
    if (is_free) taken.push(box);
    if (is_free && is_far) draw_leader(group, x, y, box);
    const aside = (5 + width_of(tag.id) / 2) * (x + 5 + width_of(tag.id) > room[2] ? -1 : 1);
    write_label(group, is_free ? box : around(x + aside, y, 0, TEXT_HEIGHT), is_free ? 'halo' : 'halo spare', tag.id);
  }
}

const path_of = points => `M${points.map(point => point.map(each => each.toFixed(1)).join()).join('L')}`;

function readout_of(sensor, point) {
  if (!point) return '';
  const { tag, at, value, low, high } = point, time = state.clock === 'wall' ? clock(at) : day_time(at);
  const range = low === undefined ? '' : ` (${written(sensor, low)} to ${written(sensor, high)})`;
  return `tag ${tag.id}, ${time}: ${with_unit(sensor, value)}${range}`;
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

// The chosen tag

function show_chosen() {
  const tag = chosen_tag();
  pieces(element('chosen'), tag ? facts_of(tag) : []);
  if (!tag) {
    const hint = add(element('chosen'), 'span', 'Choose a tag in the map, the table or a chart', 'muted');
    hint.id = 'hint';
    add(hint, 'span', ', or with the arrow keys in the map', 'keys');
    hint.append('.');
  }
  const dots = [...document.querySelectorAll('#map a')], focused = document.activeElement;
  for (const each of [...dots, ...document.querySelectorAll('.series')]) {
    const is_chosen = tag !== undefined && each.dataset.tag === tag.id;
    each.classList.toggle('chosen', is_chosen);
    if (is_chosen && each.nextSibling) each.parentNode.append(each);  // above the others
  }
  const current = dots.find(dot => dot.dataset.tag === tag?.id) ?? dots[0];
  for (const dot of dots) {
    dot.setAttribute('tabindex', dot === current ? 0 : -1);
    dot.removeAttribute('aria-current');
  }
  if (dots.includes(focused)) focused.focus({ preventScroll: true });  // it was moved
  if (tag) current?.setAttribute('aria-current', 'true');
  for (const each of data.tags) {
    const link = each.row.querySelector('a');
    each.row.classList.toggle('chosen', each === tag);
    if (each === tag) link.setAttribute('aria-current', 'true');
    else link.removeAttribute('aria-current');
  }
}

const KEY_STEPS = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
element('map').addEventListener('keydown', event => {
  const step = KEY_STEPS[event.key];
  if (!step || !placed_tags.length) return;
  event.preventDefault();
  const here = placed_tags.findIndex(tag => tag.id === document.activeElement.dataset.tag);
  choose(placed_tags[(here + step + placed_tags.length) % placed_tags.length]);
  show_chosen();
  document.querySelector('#map a.chosen')?.focus();
});
element('tabs').addEventListener('keydown', event => {
  if (!KEY_STEPS[event.key]) return;
  event.preventDefault();
  pick(state.sensor + KEY_STEPS[event.key]);
  element('tabs').children[state.sensor].focus();
});
document.addEventListener('keydown', event => { if (event.key === 'Escape') choose(); });
document.querySelectorAll('[name=clock]').forEach(each => each.addEventListener('change', () => {
  state.clock = each.value;
  draw_charts();
}));

function draw_all(is_printed = state.is_printed) {
  state.is_printed = is_printed;
  draw_tabs();
  draw_map();
  draw_charts();
}

document.documentElement.style.setProperty('--colours', data.colours);
document.querySelector('#failed b').textContent = failure_words.length > 1 ? 'not read' : failure_words[0];
element('bins').hidden = !data.is_binned;
element('failed').hidden = !failure_words.length;
element('tables').hidden = !data.tables.length;
element('route').hidden = data.route.length < 2;
element('zone').textContent = `wall time (${zone})`;
element('charts').hidden = !data.sensors.length;
write_head();
write_table();
draw_all();
addEventListener('hashchange', show_chosen);
let drawn_width = innerWidth;
addEventListener('resize', () => {
  if (state.is_printed || drawn_width === innerWidth) return;
  drawn_width = innerWidth;
  draw_all();
});
addEventListener('beforeprint', () => draw_all(true));
addEventListener('afterprint', () => draw_all(false));
