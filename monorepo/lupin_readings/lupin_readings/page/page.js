// Writes the page, and follows keys, the address and the width of the window.
import {
  clamp, clock, data, date, element, failure_words, is_one_day, placed_tags, short_zone, state, tags_in_table, zone,
} from './data.js';
import { mark, write_pieces } from './drawing.js';
import { choose, choose_next, show_chosen } from './choice.js';
import { aspect, draw_map, draw_tab, pick } from './map.js';
import { fit_table, write_table, write_tags } from './table.js';
import { draw_charts, has_charts, is_line, is_long } from './charts.js';

const KEY_STEPS = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

function write_head() {
  const whole = text => text.replaceAll(' ', '\u00a0');  // stays on one line
  const ends = new Set(data.span_ms.map(ms => whole(`${is_one_day ? '' : `${date(ms)} `}${clock(ms)}`)));
  const duration = ends.size > 1 ? ` (${whole(data.duration)})` : '', last = data.span_ms.at(-1);
  const span = ends.size ? `${[...ends].join(' to ')} ${short_zone(last)}${duration}` : '';
  const when = is_one_day && span ? [whole(date(last)), whole(span)] : [span];
  element('title').textContent = ['Simulated readings', ...when].filter(Boolean).join(', ');
  write_pieces(element('counts'), data.counts.map(([text]) => text), number => data.counts[number][1]);
  write_pieces(element('file'), [data.title, data.greenhouse_times].filter(Boolean));
  data.failures.forEach(failure => write_tags(mark(element('failures'), 'li'), failure, 'bad'));
  data.notes.forEach(note => mark(element('notes'), 'p', {}, note));
}

// Shows the explanations that this page needs, and hides the others.
function write_explanations() {
  const has_blanks = tags_in_table.some(tag => !tag.has_failed && tag.values.includes(null));
  const shown = {
    failed: failure_words.length > 0,
    goals: placed_tags.some(tag => tag.goal),
    tables: data.tables.length > 0,
    route: data.route.length > 1,
    stops: data.stops.length > 0,
    moments: data.is_of_several_times,
    blanks: data.is_complete && has_blanks,
    bins: data.is_binned,
    charts: has_charts,
  };
  for (const [id, is_shown] of Object.entries(shown)) element(id).hidden = !is_shown;
  document.querySelector('#failed b').textContent = failure_words.length > 1 ? 'not read' : failure_words[0];
  if (!is_line) document.querySelector('#charts h2').textContent = 'When each tag was read';
  element('zone').textContent = `wall time (${zone})`;
}

function set_style() {
  const { style } = document.documentElement;
  style.setProperty('--colours', data.colours);
  style.setProperty('--aspect', aspect);
  style.setProperty('--sensors', data.sensors.length);
  document.body.classList.toggle('tall', aspect < 1);
  document.body.classList.toggle('lone', data.sensors.length === 1);
  element('charts').classList.toggle('long', is_long);
}

function follow_keys() {
  element('map').addEventListener('keydown', event => {
    if (!KEY_STEPS[event.key]) return;
    event.preventDefault();
    choose_next(KEY_STEPS[event.key]);
  });
  element('tabs').addEventListener('keydown', event => {
    if (!KEY_STEPS[event.key]) return;
    event.preventDefault();
    pick(state.sensor + KEY_STEPS[event.key]);
    element('tabs').children[state.sensor].focus();
  });
  document.addEventListener('keydown', event => { if (event.key === 'Escape') choose(); });
  document.querySelector('#chosen button').addEventListener('click', () => choose());
  for (const button of document.querySelectorAll('[name=clock]')) {
    button.checked = button.value === state.clock;
    button.addEventListener('change', () => {
      state.clock = button.value;
      draw_charts();
    });
  }
  addEventListener('hashchange', show_chosen);
}

// Draws again if the width of the window or of the map has changed.
function follow_window() {
  const widths = () => `${innerWidth} ${element('map').clientWidth}`;
  let drawn_widths = widths();
  addEventListener('resize', () => {
    if (drawn_widths === widths()) return;
    drawn_widths = widths();
    fit_table();
    draw_map();
    draw_charts();
  });
  // The header of the table stays while the page scrolls.
  addEventListener('scroll', () => {
    const head = document.querySelector('thead'), { top, height } = head.parentNode.getBoundingClientRect();
    head.style.transform = `translateY(${clamp(-top, 0, Math.max(height - 2 * head.offsetHeight, 0))}px)`;
  }, { passive: true });
}

set_style();
write_explanations();
write_head();
write_table();
fit_table();
data.sensors.forEach(draw_tab);
if (data.sensors.length) pick(0);
else draw_map();
draw_charts();
follow_keys();
follow_window();
