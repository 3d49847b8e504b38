// Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
'use strict';
// Draws the page of readings from the data in it. The chosen tag is the fragment of the address: #tag=28.
const data = JSON.parse(document.getElementById('data').textContent);
const VIRIDIS = ['440154', '482475', '414487', '355f8d', '2a788e', '21918c', '22a884', '44bf70', '7ad151', 'bddf26', 'fde725'];
const PAPER = { map: [440, 740], tab: [104, 158], chart: [222, 165] };  // pixels in print
const MOST_LABELLED = 100;  // lines of a chart; of more, only the chosen one has a label
const element = id => document.getElementById(id);
const by_id = new Map(data.tags.map(tag => [tag.id, tag]));
const state = { sensor: 0, clock: 'wall', sort: null, is_down: false, is_printed: false };
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
const grouped = number => number.toLocaleString('en');
const pad = number => String(number).padStart(2, '0');
const clock = ms => { const there = new Date(ms); return [there.getHours(), there.getMinutes(), there.getSeconds()].map(pad).join(':'); };
const date = ms => new Date(ms).toLocaleDateString('en-GB', { day: 'numeric', month: 'short', year: 'numeric' });
const day_time = seconds => `${pad(Math.floor(seconds / 3600))}:${pad(Math.floor(seconds / 60) % 60)}`;
const written = (sensor, value) => value.toFixed(sensor.decimals);
const with_unit = (sensor, value) => `${written(sensor, value)} ${sensor.unit}`.trim();
const address = tag => `#tag=${encodeURIComponent(tag.id)}`;
const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
const failed_words = [...new Set(data.tags.filter(tag => tag.has_failed).map(tag => tag.outcome))];  // one of them is said in the key alone
const is_one_day = !data.span_ms.length || date(data.span_ms[0]) === date(data.span_ms[1]);

function chosen_tag() {
  try {
    return by_id.get(decodeURIComponent(location.hash.replace(/^#tag=/, '')));
  } catch {
    return undefined;  // not an address of ours
  }
}

function choose(tag) {
  if (tag) location.hash = address(tag);
  else { history.replaceState(null, '', location.pathname + location.search); show_chosen(); }
}

// The head

function write_head() {
  document.title = `Readings of ${data.title}`;
  const parts = [`${grouped(data.read_count)} of ${grouped(data.tag_count)} tags read`, ...data.counts.map(([word, count]) => `${grouped(count)} ${word}`)];
  if (data.span_ms.length) {
    const times = data.span_ms.map(ms => `${is_one_day ? '' : `${date(ms)} `}${clock(ms)}`);
    parts.push(times[0] === times[1] ? times[0] : `${times.join(' to ')} (${data.lasting})`);
    const [from, to] = data.day_span;
    parts.push(`greenhouse ${[...new Set([from, to].map(day_time))].join(' to ')}${data.days - 1 > (to < from) ? ` over at least ${grouped(data.days)} days` : ''}`);
  }
  pieces(document.querySelector('h1'), parts, number => data.counts[number - 1]?.[2]);
  pieces(element('file'), [data.title, ...data.span_ms.slice(0, 1).map(ms => is_one_day ? date(ms) : ''), `times in ${zone}`, data.speed].filter(Boolean));
  for (const { word, reason, tags, count } of data.failures) {
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
  data.notes.forEach(note => add(element('notes'), 'p', note));
}

// The map

const limits_of = number => data.sensors[number].range;
const colour = share => {
  const place = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1), left = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const parts = [0, 2, 4].map(at => [left, left + 1].map(n => parseInt(VIRIDIS[n].slice(at, at + 2), 16)));
  return `rgb(${parts.map(([a, b]) => Math.round(a + (b - a) * (place - left))).join()})`;
};
const value_of = (tag, number) => tag.has_failed || !data.sensors.length ? null : tag.values[number];
const view = (() => {
  const corners = [data.walls.slice(0, 2), data.walls.slice(2), ...data.route, ...data.tables.flatMap(each => [each.slice(0, 2), each.slice(2)]),
    ...data.tags.filter(tag => tag.x !== null).map(tag => [tag.x, tag.y])];
  const side = (axis, sign) => sign * corners.reduce((most, corner) => Math.max(most, sign * corner[axis]), -Infinity);
  return { x0: side(0, -1), y0: side(1, -1), width: side(0, 1) - side(0, -1), height: side(1, 1) - side(1, -1) };
})();

function frame_of(width, height, margin) {
  const scale = Math.max(Math.min((width - margin.left - margin.right) / view.width, (height - margin.top - margin.bottom) / view.height), 1e-6);
  const wide = view.width * scale, high = view.height * scale;
  return {
    scale, width: Math.max(width, 1), height: high + margin.top + margin.bottom,
    x: x => margin.left + (width - margin.left - margin.right - wide) / 2 + (x - view.x0) * scale,
    y: y => margin.top + high - (y - view.y0) * scale,
  };
}

function draw_ground(svg, frame) {
  const box = ([x0, y0, x1, y1], name) => draw(svg, 'rect', {
    x: frame.x(x0), y: frame.y(y1), width: (x1 - x0) * frame.scale, height: (y1 - y0) * frame.scale, class: name });
  box(data.walls, 'wall');
  data.tables.forEach(corners => box(corners, 'bench'));
}

// Returns the points of the route in pixels, one for each few pixels of its length.
function draw_route(svg, frame) {
  const way = data.route.map(([x, y]) => [frame.x(x), frame.y(y)]);
  const steps = [];
  if (way.length < 2) return steps;
  draw(svg, 'path', { class: 'route', d: `M${way.map(point => point.map(each => each.toFixed(1)).join()).join('L')}` });
  const arrows = [];
  let travelled = 0, last = 0;
  way.slice(1).forEach(([x, y], number) => {
    const [from_x, from_y] = way[number], length = Math.hypot(x - from_x, y - from_y), turn = Math.atan2(y - from_y, x - from_x) * 180 / Math.PI;
    for (let at = 8 - travelled % 8; at < length; at += 8) {
      steps.push([from_x + (x - from_x) * at / length, from_y + (y - from_y) * at / length]);
      const [here_x, here_y] = steps.at(-1);
      if (steps.length - last < 9 || arrows.some(([a, b]) => Math.hypot(a - here_x, b - here_y) < 16)) continue;
      last = steps.length;
      arrows.push(steps.at(-1));
      draw(svg, 'path', { class: 'arrow', d: 'M5 0L-4 -3.5L-4 3.5Z', transform: `translate(${steps.at(-1)}) rotate(${turn})` });
    }
    travelled += length;
  });
  const [[start_x, start_y], [end_x, end_y]] = [way[0], way.at(-1)];
  draw(svg, 'circle', { class: 'end', cx: start_x, cy: start_y, r: 4.5 });
  draw(svg, 'rect', { class: 'end', x: end_x - 4, y: end_y - 4, width: 8, height: 8 });
  return steps;
}

const common = (a, b) => Math.max(Math.min(a[2], b[2]) - Math.max(a[0], b[0]), 0) * Math.max(Math.min(a[3], b[3]) - Math.max(a[1], b[1]), 0);
const around = (x, y, width, height) => [x - width / 2, y - height / 2, x + width / 2, y + height / 2];

// Returns the box in which a label covers least, and whether it lies too far from its dot to need no line.
function place_label(x, y, radius, width, height, taken, way, room) {
  const aside = radius + width / 2 + 4, above = radius + height / 2 + 1;
  const near = [[aside, 0], [-aside, 0], [0, -above], [0, above], ...[-above, above].flatMap(dy => [[aside / 2, dy], [-aside / 2, dy]]), ...[0.75, -0.75].flatMap(up => [[aside, up * above], [-aside, up * above]])];
  const far = [[aside + 14, 0], [-aside - 14, 0], ...[1, -1].flatMap(up => [[aside + 6, up * above * 1.7], [-aside - 6, up * above * 1.7], [0, up * above * 2.2]])];
  const reach = around(x, y, 4 * aside + width, 6 * above + height);
  const [boxes, points] = [taken, way].map(each => each.filter(box => common(reach, box) > 0));
  let best = null;
  [...near, ...far].forEach(([dx, dy], number) => {
    const box = around(x + dx, y + dy, width, height), area = width * height;
    const covered = boxes.reduce((sum, each) => sum + common(box, each), 0);
    const cost = covered + 5 * points.reduce((sum, each) => sum + common(box, each), 0) + 2 * (area - common(box, room)) + number * 0.01 * area;
    if (!best || cost < best.cost) best = { box, cost, covered, is_far: number >= near.length };
  });
  return best;
}

function draw_map() {
  const place = element('map'), number = state.sensor, sensor = data.sensors[number];
  const size = state.is_printed ? PAPER.map : [place.clientWidth, innerWidth < 704 ? Infinity : Math.max(innerHeight - place.getBoundingClientRect().top - scrollY - 62, 460)];
  const frame = frame_of(...size, { left: 40, right: 12, top: 6, bottom: 34 });
  const svg = drawing(place, frame.width, frame.height, { role: 'group', 'aria-label': 'Map of the greenhouse. The arrow keys choose the next tag.' });
  const room = [frame.x(view.x0), frame.y(view.y0 + view.height), frame.x(view.x0 + view.width), frame.y(view.y0)];
  draw_axes(svg, frame, room);
  draw_ground(svg, frame);
  const way = draw_route(svg, frame).map(point => around(...point, 4, 4));
  const tags = data.tags.filter(tag => tag.x !== null).map(tag => ({ tag, x: frame.x(tag.x), y: frame.y(tag.y) }));
  const gap = tags.slice(0, 400).reduce((least, one, n) => tags.slice(n + 1, 400).reduce(
    (low, other) => Math.hypot(one.x - other.x, one.y - other.y) > 1 ? Math.min(low, Math.hypot(one.x - other.x, one.y - other.y)) : low, least), Infinity);
  const radius = Math.min(Math.max(gap / 2 - 1, 2.5), 9);
  const radius_of = tag => tag.has_failed || value_of(tag, number) !== null ? radius : Math.min(radius, 4.5);
  const extremes = (sensor?.extremes ?? []).flatMap(([, numbers]) => numbers.map(each => data.tags[each])), ring_of = tag => radius_of(tag) + (extremes.includes(tag) ? 3 : 0);
  const taken = tags.map(({ tag, x, y }) => around(x, y, 2 * ring_of(tag), 2 * ring_of(tag)));
  if (data.route.length > 1) {
    const [start, end] = [data.route[0], data.route.at(-1)].map(([x, y]) => [frame.x(x), frame.y(y)]);
    for (const [word, [x, y]] of Math.hypot(start[0] - end[0], start[1] - end[1]) < 8 ? [['start and end', start]] : [['start', start], ['end', end]]) {
      const { box } = place_label(x, y, 5, pen.measureText(word).width + 16, 13, taken, way, room);
      taken.push(around(x, y, 10, 10), box);
      draw(svg, 'text', { class: 'muted halo', x: (box[0] + box[2]) / 2, y: box[3] - 3, 'text-anchor': 'middle' }, word);
    }
  }
  const limits = sensor ? limits_of(number) : [0, 1];
  const urgent = ({ tag }) => tag.has_failed ? 0 : value_of(tag, number) !== null ? 1 : 2;
  const leaders = draw(svg, 'g');
  for (const { tag, x, y } of [...tags].sort((one, other) => urgent(one) - urgent(other))) {
    const value = value_of(tag, number), mine = radius_of(tag);
    const group = draw(svg, 'a', { href: address(tag), 'data-tag': tag.id, tabindex: -1, class: tag.has_failed ? 'failed' : '' });
    draw(group, 'title', {}, hover_of(tag));  // its name for a screen reader, too
    if (extremes.includes(tag)) draw(group, 'circle', { class: 'extreme', cx: x, cy: y, r: mine + 3 });
    draw(group, 'circle', { class: 'ring', cx: x, cy: y, r: mine + 3 });
    if (tag.has_failed) {
      draw(group, 'circle', { class: 'dot empty', cx: x, cy: y, r: mine });
      const arm = mine * 0.5;
      draw(group, 'path', { class: 'cross', d: `M${x - arm} ${y - arm}L${x + arm} ${y + arm}M${x - arm} ${y + arm}L${x + arm} ${y - arm}` });
    } else if (value === null) draw(group, 'circle', { class: 'dot empty', cx: x, cy: y, r: mine });
    else draw(group, 'circle', { class: 'dot', cx: x, cy: y, r: mine, fill: colour((value - limits[0]) / (limits[1] - limits[0])) });
    const mark = value === null ? '' : value > limits[1] ? ' ▲' : value < limits[0] ? ' ▼' : '';
    const text = value === null ? tag.has_failed ? failed_words.length > 1 ? ` ${tag.outcome}` : '' : '' : `: ${written(sensor, value)}${mark}`;
    const width = pen.measureText(tag.id + text).width + Math.min(tag.id.length, 12) + 6;
    const { box, covered, is_far } = place_label(x, y, ring_of(tag), width, 13, taken, way, room);
    if (covered > 0.12 * width * 13) continue;
    taken.push(box);
    if (is_far) draw(leaders, 'line', { class: 'leader', x1: x, y1: y, x2: Math.min(Math.max(x, box[0]), box[2]), y2: Math.min(Math.max(y, box[1]), box[3]) });
    const label = draw(group, 'text', { class: urgent({ tag }) === 2 ? 'muted halo' : 'halo', x: (box[0] + box[2]) / 2, y: box[3] - 3, 'text-anchor': 'middle' });
    draw(label, 'tspan', { class: urgent({ tag }) === 2 ? '' : 'id' }, tag.id);
    if (text) draw(label, 'tspan', {}, text);
  }
  draw_scale(frame.width, limits);
  show_chosen();
}

function draw_axes(svg, frame, room) {
  const step = nice_step(60 / frame.scale);
  const ticks = (from, to) => Array.from({ length: Math.floor(to / step) - Math.ceil(from / step) + 1 }, (_, n) => (Math.ceil(from / step) + n) * step);
  for (const x of ticks(view.x0, view.x0 + view.width)) draw(svg, 'text', { class: 'muted', x: frame.x(x), y: room[3] + 15, 'text-anchor': 'middle' }, String(Number(x.toPrecision(6))));
  for (const y of ticks(view.y0, view.y0 + view.height)) draw(svg, 'text', { class: 'muted', x: room[0] - 7, y: frame.y(y) + 4, 'text-anchor': 'end' }, String(Number(y.toPrecision(6))));
  draw(svg, 'text', { class: 'muted', x: (room[0] + room[2]) / 2, y: room[3] + 30, 'text-anchor': 'middle' }, 'x (m)');
  draw(svg, 'text', { class: 'muted', transform: `translate(${room[0] - 30} ${(room[1] + room[3]) / 2}) rotate(-90)`, 'text-anchor': 'middle' }, 'y (m)');
}

function draw_scale(width, limits) {
  const sensor = data.sensors[state.sensor], svg = drawing(element('scale'), width, 46, { role: 'img', 'aria-label': sensor ? `Colours from ${limits.map(each => with_unit(sensor, each)).join(' to ')}` : 'Key of the map' });
  let x = 12;
  const key = (shape, text) => {
    shape(x, 38);
    draw(svg, 'text', { class: 'muted', x: x + 12, y: 42 }, text);
    x += pen.measureText(text).width + 30;
  };
  if (sensor) {
    const fill = draw(draw(svg, 'defs'), 'linearGradient', { id: 'viridis' });
    VIRIDIS.forEach((each, n) => draw(fill, 'stop', { offset: n / (VIRIDIS.length - 1), 'stop-color': `#${each}` }));
    const wide = Math.max(Math.min(width - 130, 260), 40);
    const label = (at, text, anchor) => draw(svg, 'text', { class: 'muted', x: at, y: 14, 'text-anchor': anchor }, text);
    const low = String(Number(limits[0].toPrecision(4)));
    const from = 40 + pen.measureText(low).width;
    label(from - 6, low, 'end');
    draw(svg, 'rect', { x: from, y: 4, width: wide, height: 12, fill: 'url(#viridis)' });
    label(from + wide + 6, `${Number(limits[1].toPrecision(4))} ${sensor.unit}`, 'start');
    const outside = data.tags.map(tag => value_of(tag, state.sensor)).filter(value => value !== null && (value < limits[0] || value > limits[1])).length;
    if (outside) key(() => {}, `▲ above, ▼ below the scale: ${outside}`);
  }
  if (failed_words.length) key((at, y) => draw(svg, 'path', { class: 'cross', d: `M${at - 4} ${y - 4}l8 8m-8 0l8 -8` }), failed_words.length > 1 ? 'not read' : failed_words[0]);
  key((at, y) => draw(svg, 'circle', { class: 'dot empty', cx: at, cy: y, r: 4.5 }), sensor ? `no ${sensor.name}` : 'tag');
  if (data.tables.length) key((at, y) => draw(svg, 'rect', { class: 'bench', x: at - 5, y: y - 5, width: 10, height: 10 }), 'table');
  if (data.route.length > 1) key((at, y) => { draw(svg, 'path', { class: 'route', d: `M${at - 7} ${y}h14` }); draw(svg, 'path', { class: 'arrow', d: 'M5 0L-4 -3.5L-4 3.5Z', transform: `translate(${at} ${y})` }); }, 'route');
}

function draw_tabs() {
  element('tabs').replaceChildren();
  const tabs = data.sensors.map(() => add(element('tabs'), 'button'));  // all, before one is measured
  tabs.forEach((tab, number) => {
    const sensor = data.sensors[number];
    tab.type = 'button';
    tab.setAttribute('role', 'tab');
    tab.setAttribute('aria-controls', 'panel');
    tab.addEventListener('click', () => pick(number));
    add(tab, 'b', sensor.name);
    const frame = frame_of(...state.is_printed ? PAPER.tab : [Math.max(tab.clientWidth - 12, 20), 170], { left: 2, right: 2, top: 2, bottom: 2 });
    const svg = draw(tab, 'svg', { width: frame.width, height: frame.height, 'aria-hidden': true });
    draw_ground(svg, frame);
    const limits = limits_of(number), radius = Math.max(Math.min(frame.scale * 0.22, 6), 1.5);
    for (const tag of data.tags.filter(each => each.x !== null)) {
      const value = value_of(tag, number), [cx, cy] = [frame.x(tag.x), frame.y(tag.y)], arm = radius * 0.8;
      if (value !== null) draw(svg, 'circle', { cx, cy, r: radius, stroke: 'currentColor', 'stroke-width': 0.7, fill: colour((value - limits[0]) / (limits[1] - limits[0])) });
      else if (tag.has_failed) draw(svg, 'path', { class: 'cross thin', d: `M${cx - arm} ${cy - arm}l${2 * arm} ${2 * arm}m${-2 * arm} 0l${2 * arm} ${-2 * arm}` });
    }
    const values = data.tags.map(tag => value_of(tag, number)).filter(value => value !== null);
    const ends = new Set(values.length ? [Math.min(...values), Math.max(...values)].map(value => written(sensor, value)) : ['no value']);
    add(tab, 'span', `${[...ends].join(' to ')} ${values.length ? sensor.unit : ''}`.trim());
    if (state.is_printed) {
      const key = add(tab, 'span', `${+limits[0].toPrecision(3)} `, 'key');
      add(key, 'i').style.background = `linear-gradient(to right, ${[0, 0.25, 0.5, 0.75, 1].map(colour)})`;
      key.append(` ${+limits[1].toPrecision(3)}`);
    }
    for (const [text] of sensor.extremes) add(tab, 'span', text.replace(/ (?=\S+ at )/, '\u00a0'), 'extremes');  // on paper
  });
  mark_tab();
}

function mark_tab() {
  [...element('tabs').children].forEach((tab, n) => {
    tab.setAttribute('aria-selected', n === state.sensor);
    tab.tabIndex = n === state.sensor ? 0 : -1;
  });
  const sensor = data.sensors[state.sensor];
  element('shown').textContent = sensor ? sensor.label : 'No tag was read';
  const words = sensor?.extremes.map(([text]) => text) ?? [];
  pieces(element('extremes'), words.map((text, n) => n ? text : `ringed: ${text}`));
}

function pick(number) {
  state.sensor = (number + data.sensors.length) % data.sensors.length;
  mark_tab();
  draw_map();
}

// The table

const hover_of = tag => [`tag ${tag.id}: ${tag.outcome}${tag.reason ? ` (${tag.reason})` : ''}`,
  ...data.sensors.flatMap((sensor, n) => tag.values[n] === null || tag.has_failed ? [] : [`${sensor.name} ${with_unit(sensor, tag.values[n])}`]),
  ...tag.stamp_ms === null ? [] : [`${clock(tag.stamp_ms)} (greenhouse ${day_time(tag.time_of_day)})`],
  ...tag.attempts > 1 ? [`${tag.attempts} attempts`] : []].join(' · ');

const dates = new Set(data.tags.filter(tag => tag.stamp_ms !== null).map(tag => date(tag.stamp_ms)));
const has_attempts = data.tags.some(tag => tag.attempts > 1);
const columns = [
  { name: 'tag', of: (tag, n) => n },
  { name: 'outcome', of: tag => tag.outcome },
  ...data.sensors.map((sensor, n) => ({ name: sensor.name, unit: sensor.unit, of: tag => value_of(tag, n), is_number: true })),
  { name: 'time', unit: dates.size === 1 ? [...dates][0] : '', of: tag => tag.stamp_ms, is_number: true },
  { name: 'greenhouse', unit: 'time of day', of: tag => tag.time_of_day, is_number: true },
  ...has_attempts ? [{ name: 'attempts', of: tag => tag.attempts, is_number: true }] : [],
];

function write_table() {
  const head = add(add(document.querySelector('table'), 'thead'), 'tr');
  columns.forEach((column, number) => {
    const cell = add(head, 'th', '', column.is_number ? 'number' : '');
    cell.scope = 'col';
    const button = add(cell, 'button', column.name);
    button.type = 'button';
    if (column.unit) add(cell, 'small', column.unit);
    button.addEventListener('click', () => {
      state.is_down = state.sort === number && !state.is_down;
      state.sort = number;
      [...head.children].forEach(each => each.removeAttribute('aria-sort'));
      cell.setAttribute('aria-sort', state.is_down ? 'descending' : 'ascending');
      sort_table();
    });
  });
  const body = add(document.querySelector('table'), 'tbody');
  data.tags.forEach((tag, number) => {
    tag.number = number;
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
    } else {
      const times = tag.stamp_ms === null ? ['', ''] : [`${dates.size > 1 ? `${date(tag.stamp_ms)} ` : ''}${clock(tag.stamp_ms)}`, day_time(tag.time_of_day)];
      const values = data.sensors.map((sensor, n) => tag.values[n] === null ? '' : written(sensor, tag.values[n]));
      [...values, ...times].forEach(text => add(tag.row, 'td', text, 'number'));
    }
    if (has_attempts) add(tag.row, 'td', tag.attempts ?? '', 'number');
    tag.row.addEventListener('click', () => choose(tag));
  });
  const search = document.querySelector('input[type=search]');
  search.hidden = data.tags.length <= 50;
  search.addEventListener('input', () => data.tags.forEach(tag => { tag.row.hidden = !tag.id.toLowerCase().includes(search.value.toLowerCase()); }));
}

function sort_table() {
  const { of } = columns[state.sort], sign = state.is_down ? -1 : 1;
  const compare = (one, other) => {
    if (one.has_failed !== other.has_failed) return one.has_failed ? -1 : 1;
    const [a, b] = [one, other].map(tag => of(tag, tag.number) ?? null);
    if (a === null || b === null) return (a === null) - (b === null) || one.number - other.number;
    return sign * (a < b ? -1 : a > b ? 1 : 0) || one.number - other.number;
  };
  document.querySelector('tbody').append(...[...data.tags].sort(compare).map(tag => tag.row));
}

// The charts

const nice_step = least => {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map(each => each * power).find(each => each >= least * 0.999);
};
const WALL_STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400].map(each => each * 1000);

function wall_axis(width) {
  const [first, last] = data.span_ms, slack = Math.max((last - first) * 0.01, 250);
  const [low, high] = [first - slack, last + slack], least = (high - low) / Math.max(width / 64, 1);
  const step = WALL_STEPS.find(each => each >= least) ?? Math.ceil(least / 86400000) * 86400000;
  const offset = new Date(first).getTimezoneOffset() * 60000, ticks = [];
  for (let at = Math.ceil((low - offset) / step) * step + offset; at <= high; at += step) ticks.push(at);
  if (ticks.length < 2) ticks.splice(0, 1, first, last);
  const text = ms => step >= 86400000 ? date(ms).slice(0, -5) : step < 60000 ? clock(ms) : clock(ms).slice(0, 5);
  return { low, high, ticks, text, start: first };
}

const day_axis = width => ({ low: 0, high: 86400, start: 0, text: day_time, ticks: Array.from({ length: width < 330 ? 5 : 9 }, (_, n) => n * (width < 330 ? 21600 : 10800)) });

function draw_charts() {
  const grid = element('figures');
  grid.replaceChildren();
  const figures = data.sensors.filter(sensor => sensor.lines.length).map(sensor => {
    const figure = add(grid, 'figure'), caption = add(figure, 'figcaption');
    add(caption, 'b', sensor.label);
    return [sensor, add(figure, 'div', '', 'charting'), add(caption, 'span')];  // all, before one is measured
  });
  figures.forEach(([sensor, place, readout]) => draw_chart(sensor, place, readout));
  const is_line = data.sensors.some(sensor => sensor.lines.some(line => line.wall.length > 1));
  const what = is_line ? 'Each line is a tag with its number' : 'Each point is a reading of another tag, so values differ by place as well as by time';
  element('lines').textContent = [`${what}${state.is_printed ? `; time in ${state.clock === 'wall' ? zone : 'the greenhouse'}` : ''}.`, data.is_binned ? 'Where many values share a place, the line is their median, and the band reaches from the lowest to the highest.' : ''].join(' ').trim();
  show_chosen();
}

function draw_chart(sensor, place, readout) {
  const [width, height] = state.is_printed ? PAPER.chart : [Math.max(place.clientWidth, 120), 220];
  const all = [...sensor.lines.flatMap(line => [...line.wall, ...line.day])];  // both, so that the switch keeps the scale
  const least = all.reduce((most, [, value, low]) => Math.min(most, low ?? value), Infinity), greatest = all.reduce((most, [, value, , high]) => Math.max(most, high ?? value), -Infinity);
  const step = nice_step(Math.max((greatest - least) / (height / 40), Math.abs(greatest) * 1e-6, 10 ** -sensor.decimals));
  const [bottom, top] = [Math.floor(least / step), Math.ceil(greatest / step)].map((each, n) => (least === greatest ? each + (n ? 1 : -1) : each) * step);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const ticks = Array.from({ length: Math.round((top - bottom) / step) + 1 }, (_, n) => bottom + n * step);
  const left = 10 + Math.max(...ticks.map(each => pen.measureText(each.toFixed(decimals)).width)), right = 34;
  const axis = (state.clock === 'wall' ? wall_axis : day_axis)(width - left - right);
  const x = at => left + (axis.start + at - axis.low) / (axis.high - axis.low) * (width - left - right);
  const y = value => 8 + (top - value) / (top - bottom) * (height - 34);
  const svg = drawing(place, width, height, { role: 'img', 'aria-label': `${sensor.label} of ${sensor.lines.length} tags against ${state.clock === 'wall' ? 'wall time' : 'time of day in the greenhouse'}` });
  for (const value of ticks) {
    draw(svg, 'path', { class: 'grid', d: `M${left} ${y(value)}H${width - right}` });
    draw(svg, 'text', { class: 'muted', x: left - 6, y: y(value) + 4, 'text-anchor': 'end' }, value.toFixed(decimals));
  }
  for (const at of axis.ticks) {
    draw(svg, 'path', { class: 'grid', d: `M${x(at - axis.start)} ${y(bottom)}v4` });
    draw(svg, 'text', { class: 'muted', x: x(at - axis.start), y: height - 8, 'text-anchor': 'middle' }, axis.text(at));
  }
  const points = [], ends = [], taken = [];
  for (const line of sensor.lines) {
    const tag = data.tags[line.tag], group = draw(svg, 'g', { class: line[state.clock].length > 1 ? 'series line' : 'series', 'data-tag': tag.id });
    const places = line[state.clock].map(([at, value, low, high]) => ({ tag, at: axis.start + at, x: x(at), y: y(value), value, low, high }));
    points.push(...places);
    const runs = runs_of(places);
    for (const run of runs) {
      const up = run.map(p => [p.x, y(p.high ?? p.value)]), down = run.map(p => [p.x, y(p.low ?? p.value)]).reverse();
      if (run.length > 1 && run.some(p => p.low !== undefined)) draw(group, 'path', { class: 'band', d: path_of([...up, ...down]) });
    }
    for (const run of runs) {
      if (run.length > 1) draw(group, 'path', { d: path_of(run.map(p => [p.x, p.y])) });
      if (places.length < 30) run.forEach(p => draw(group, 'circle', { cx: p.x, cy: p.y, r: 2.5 }));
    }
    if (places.length) ends.push([group, places.at(-1)]);
  }
  for (const [group, { tag, x: end, y: height_of_end }] of ends) {
    const wide = pen.measureText(tag.id).width, near = [[5, 0], [-5 - wide, 0], [-wide / 2, -11], [-wide / 2, 11], ...[12, 24].flatMap(far => [[far, -far], [far, far], [-far - wide, -far], [-far - wide, far]])].map(([dx, dy]) => [end + dx, height_of_end + dy - 6, end + dx + wide, height_of_end + dy + 6]);
    const free = ends.length <= MOST_LABELLED && near.slice(0, group.matches('.line') ? 1 : near.length).find(box => box[0] >= left && box[2] <= width && box[1] >= 0 && box[3] <= y(bottom) + 6 && !taken.some(each => common(box, each) > 0) && !points.some(p => p.tag !== tag && common(box, around(p.x, p.y, 5, 5)) > 0));
    if (free) taken.push(free);
    if (near.indexOf(free) > 3) draw(group, 'line', { class: 'leader', x1: end, y1: height_of_end, x2: Math.min(Math.max(end, free[0]), free[2]), y2: Math.min(Math.max(height_of_end, free[1]), free[3]) });
    const box = free || near[end + 5 + wide > width ? 1 : 0];
    draw(group, 'text', { class: free ? 'halo' : 'halo spare', x: box[0], y: box[3] - 2 }, tag.id);
  }
  const nearest = event => {
    const at = svg.getBoundingClientRect(), [px, py] = [event.clientX - at.left, event.clientY - at.top];
    return points.reduce((best, p) => Math.hypot(p.x - px, p.y - py) < best[0] ? [Math.hypot(p.x - px, p.y - py), p] : best, [40, null])[1];
  };
  place.addEventListener('pointermove', event => { const near = nearest(event); readout.textContent = near ? said_of(sensor, near) : ''; });
  place.addEventListener('pointerleave', () => { readout.textContent = ''; });
  place.addEventListener('click', event => choose(nearest(event)?.tag));
}

const path_of = points => `M${points.map(point => point.map(each => each.toFixed(1)).join()).join('L')}`;
const said_of = (sensor, { tag, at, value, low, high }) => `tag ${tag.id}, ${state.clock === 'wall' ? clock(at) : day_time(at)}: ${with_unit(sensor, value)}`
  + (low === undefined ? '' : ` (${written(sensor, low)} to ${written(sensor, high)})`);

// Returns the points of a line in pieces: a gap of many times the usual distance has no line.
function runs_of(points) {
  const gaps = points.slice(1).map((p, n) => p.at - points[n].at).sort((a, b) => a - b);
  const longest = 8 * (gaps[Math.floor(gaps.length / 2)] ?? 0), runs = [];
  points.forEach((p, n) => (n && p.at - points[n - 1].at <= longest ? runs.at(-1) : runs[runs.push([]) - 1]).push(p));
  return runs;
}

// The chosen tag

function show_chosen() {
  const tag = chosen_tag();
  pieces(element('chosen'), tag ? hover_of(tag).split(' · ') : []);
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
  for (const each of document.querySelectorAll('.series .spare')) each.style.display = each.parentNode.classList.contains('chosen') ? '' : 'none';
  dots.forEach(dot => { dot.setAttribute('tabindex', -1); dot.removeAttribute('aria-current'); });
  const current = dots.find(dot => dot.dataset.tag === tag?.id) ?? dots[0];
  current?.setAttribute('tabindex', 0);
  if (dots.includes(focused)) focused.focus({ preventScroll: true });  // it was moved
  if (tag) current?.setAttribute('aria-current', 'true');
  for (const each of data.tags) {
    each.row.classList.toggle('chosen', each === tag);
    if (each === tag) each.row.querySelector('a').setAttribute('aria-current', 'true');
    else each.row.querySelector('a').removeAttribute('aria-current');
  }
}

const STEPS = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
element('map').addEventListener('keydown', event => {
  const step = STEPS[event.key], tags = data.tags.filter(tag => tag.x !== null);
  if (!step || !tags.length) return;
  event.preventDefault();
  const here = tags.findIndex(tag => tag.id === document.activeElement.dataset.tag);
  choose(tags[(here + step + tags.length) % tags.length]);
  show_chosen();
  document.querySelector('#map a.chosen')?.focus();
});
element('tabs').addEventListener('keydown', event => {
  if (!STEPS[event.key]) return;
  event.preventDefault();
  pick(state.sensor + STEPS[event.key]);
  element('tabs').children[state.sensor].focus();
});
document.addEventListener('keydown', event => { if (event.key === 'Escape') choose(); });
document.querySelectorAll('[name=clock]').forEach(each => each.addEventListener('change', () => { state.clock = each.value; draw_charts(); }));

function draw_all() {
  draw_tabs();
  draw_map();
  draw_charts();
}

element('zone').textContent = `wall time (${zone})`;
element('charts').hidden = !data.sensors.length;
write_head();
write_table();
draw_all();
addEventListener('hashchange', show_chosen);
let width = innerWidth;
addEventListener('resize', () => { if (!state.is_printed && width !== innerWidth) { width = innerWidth; draw_all(); } });
addEventListener('beforeprint', () => { state.is_printed = true; draw_all(); });
addEventListener('afterprint', () => { state.is_printed = false; draw_all(); });
