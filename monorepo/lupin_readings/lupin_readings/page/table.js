// The table of the last readings. To add a column, add it to `columns`; ci/tests/test_page.py checks that it fits.
import {
  address, clock, data, date, day_time, element, is_one_day, lost_of, MINUTE_MS, tags_in_table,
} from './data.js';
import { mark } from './drawing.js';
import { choose } from './choice.js';

const ONE_TIME_MS = MINUTE_MS;  // readings within this time need no column of times
const MOST_WITHOUT_SEARCH = 50;  // rows
const last_stamps = data.tags.map(tag => tag.stamp_ms).filter(ms => ms !== null).sort((a, b) => a - b);
const dates = [...new Set(last_stamps.map(date))], is_over_days = dates.length > 1;
const has_times = last_stamps.at(-1) - last_stamps[0] >= ONE_TIME_MS;
const has_attempts = data.tags.some(tag => tag.attempts > data.fewest_attempts);

// Each column has the text that it shows and the key that it sorts by. A failed tag has its reason in place of the
// numbers, and only the columns with `is_of_failed`. A phone shows the columns with `is_aside` at the right.
const columns = [
  { name: 'tag', key: tag => tag.number },
  ...data.sensors.map((sensor, n) => ({
    name: sensor.name, unit: sensor.unit, key: tag => tag.values[n], text: value => value.toFixed(sensor.decimals),
  })),
  ...has_times ? [{
    name: 'time', is_aside: true, unit: is_one_day || is_over_days ? '' : dates.join(), key: tag => tag.stamp_ms,
    text: ms => is_over_days ? `${date(ms)} ${clock(ms)}` : clock(ms),
  }] : [],
  ...data.is_of_several_times ? [{
    name: 'time\u00a0of\u00a0day', is_aside: true, unit: 'greenhouse', key: tag => tag.time_of_day, text: day_time,
  }] : [],
  ...has_attempts ? [{ name: 'attempts', is_aside: true, is_of_failed: true, key: tag => tag.attempts, text: String }] : [],
];
const asides = columns.filter(column => column.is_aside);

export function write_table() {
  const table = document.querySelector('table'), head = mark(mark(table, 'thead'), 'tr');
  for (const column of columns) write_head_of(head, column);
  head.firstChild.ariaSort = 'ascending';
  const choice = document.querySelector('#sort select');
  choice.addEventListener('change', () => choice.selectedOptions[0].sort());
  element('aside').hidden = asides.length !== 1;
  const [{ name, unit } = {}] = asides;
  element('aside').lastChild.textContent = [name, unit].filter(Boolean).join(', ');
  table.classList.toggle('timed', asides.length > 0 && !is_over_days);  // a phone shows them beside the values
  const body = mark(table, 'tbody');
  tags_in_table.forEach(tag => write_row(body, tag));
  data.unread.forEach(unread => write_tags(mark(element('unread'), 'p'), unread, ''));
  const search = document.querySelector('input[type=search]');
  search.hidden = tags_in_table.length <= MOST_WITHOUT_SEARCH;
  search.addEventListener('input', () => {
    for (const tag of tags_in_table) tag.row.hidden = !tag.id.toLowerCase().includes(search.value.toLowerCase());
  });
}

// Writes the head of a column, which sorts the table, and its choice on a phone.
function write_head_of(head, column) {
  const name = column.is_aside ? 'number aside' : column.text ? 'number' : '';
  const cell = mark(head, 'th', { scope: 'col', class: name });
  const sort = is_descending => {
    for (const other of head.children) other.removeAttribute('aria-sort');
    cell.ariaSort = is_descending ? 'descending' : 'ascending';
    sort_table(column.key, is_descending ? -1 : 1);
  };
  mark(cell, 'button', { type: 'button' }, column.name)
    .addEventListener('click', () => sort(cell.ariaSort === 'ascending'));
  if (column.unit) mark(cell, 'small', {}, column.unit);
  for (const arrow of '↑↓') {
    const option = mark(document.querySelector('#sort select'), 'option', {}, `${column.name} ${arrow}`);
    option.sort = () => sort(arrow === '↓');
  }
}

function write_row(body, tag) {
  tag.row = mark(body, 'tr', { class: tag.has_failed ? 'failed' : '', 'data-tag': tag.id });
  mark(mark(tag.row, 'th', { scope: 'row', title: tag.id }), 'a', { href: address(tag.id) }, tag.id);
  const is_read = tag.outcome === 'read', of_failed = columns.findIndex(column => column.is_of_failed);
  const first = is_read ? 1 : of_failed < 0 ? columns.length : of_failed, lost = lost_of(tag);
  if (!is_read) mark(tag.row, 'td', { colspan: first - 1 }, tag.outcome + (lost && `: ${lost} not read`));
  for (const { name, unit, key, text, is_aside, is_of_failed } of columns.slice(first)) {
    const cell = is_aside ? { class: 'number aside', 'data-name': asides.length > 1 ? name : '' }
      : { class: 'number', 'data-name': name, 'data-unit': unit };
    const is_shown = (is_read || is_of_failed) && key(tag) !== null;
    mark(tag.row, 'td', cell, is_shown ? text(key(tag)) : '');
  }
  tag.row.addEventListener('click', () => choose(tag));
}

// Sorts by a key: failures first, tags without a value last.
function sort_table(key, sign) {
  const compare = (one, other) => {
    if (one.has_failed !== other.has_failed) return one.has_failed ? -1 : 1;
    const [a, b] = [one, other].map(key);
    if (a === b || a === null || b === null) return (a === null) - (b === null);
    return a < b ? -sign : sign;
  };
  document.querySelector('tbody').append(...[...tags_in_table].sort(compare).map(tag => tag.row));
}

// Writes which tags were not read, and why: what happened, then Nav2's code in small letters.
export function write_tags(line, { word, reason, tags, more }, name) {
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

// Gaps are equal. Only if the columns do not fit, names of two words take two lines, and then the text is smaller.
export function fit_table() {
  const table = document.querySelector('table'), frame = table.parentNode;
  table.classList.remove('narrow', 'narrowest');
  table.style = 'width: max-content';
  const spare = () => frame.clientWidth - table.getBoundingClientRect().width;
  if (spare() < 0) table.classList.add('narrow');
  if (spare() < 0) table.classList.add('narrowest');
  table.style = `--gap: ${Math.max(Math.floor(spare() / (columns.length - 1)), 0)}px`;
}
