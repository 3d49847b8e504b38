"""
Make a PDF to print: the tag36h11 of each tag of the greenhouse, as many on an A4 page as fit.

    make tags SIDE=40                             .tags/tag36h11-40mm.pdf
    make tags SIDE=60 ARGS="--tag-file tags.json"

SIDE is the length of the black square in millimetres. Print at 100 % ("actual size") and check the ruler on
the page. Cut along the dashed lines: the white border is part of the tag.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, pluralized
from lupin_greenhouse_bridge.runtime.arguments import Parser, number_type
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_simulation.tag36h11 import MODULES, printed_marker
from matplotlib import pyplot
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline

PAGE_MM = (210.0, 297.0)  # A4
MARGIN_MM = 10.0  # printers do not print there
FOOTER_MM = 20.0  # the ruler
LABEL_MM = 7.0  # under each tag
TAG_COUNT = 587
RULER_MM = 100
SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])


def cells(side_mm: float) -> list[tuple[float, float, float, float]]:
    """Return the cells of a page, row by row: lower left corner, width and height in mm."""
    width = side_mm * (MODULES + 2) / MODULES  # with the white margin
    height = width + LABEL_MM
    columns = int((PAGE_MM[0] - 2 * MARGIN_MM) / width)
    rows = int((PAGE_MM[1] - 2 * MARGIN_MM - FOOTER_MM) / height)
    left, top = (PAGE_MM[0] - columns * width) / 2, PAGE_MM[1] - MARGIN_MM
    corners = [
        (left + column * width, top - (row + 1) * height) for row in range(rows) for column in range(columns)
    ]
    return [(x, y, width, height) for x, y in corners]


def draw_page(tag_numbers: list[int], side_mm: float) -> Figure:
    """Return one page; its coordinates are millimetres from the lower left corner."""
    figure = pyplot.figure(figsize=[side / 25.4 for side in PAGE_MM])
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, PAGE_MM[0]), ylim=(0, PAGE_MM[1]))
    axes.axis('off')
    module_mm = side_mm / MODULES
    for tag_number, (x, y, width, height) in zip(tag_numbers, cells(side_mm), strict=False):
        squares = [
            Outline(module_mm * (SQUARE + np.array([column + 1, -row - 2])) + (x, y + height), closed=True)
            for row, column in np.argwhere(printed_marker(tag_number) == 0)
        ]
        # One shape, so that no viewer shows seams between its squares.
        axes.add_patch(PathPatch(Outline.make_compound_path(*squares), facecolor='black', linewidth=0))
        axes.add_patch(Rectangle((x, y), width, height, fill=False, edgecolor='0.6', linewidth=0.3, ls='--'))
        axes.text(x + width / 2, y + 2.0, f'id {tag_number}', ha='center', fontsize=min(12.0, side_mm / 3))
    millimetres = np.arange(RULER_MM + 1)
    lengths = np.select([millimetres % 10 == 0, millimetres % 5 == 0], [6.0, 4.0], 2.5)
    axes.vlines((PAGE_MM[0] - RULER_MM) / 2 + millimetres, 18.0, 18.0 + lengths, 'black', linewidth=0.3)
    text = f'tag36h11, black square {side_mm:g} mm. This ruler is {RULER_MM} mm long if printed at 100 %.'
    axes.text(PAGE_MM[0] / 2, 12.0, text, ha='center', fontsize=8)
    return figure


def write(path: Path, tag_numbers: list[int], side_mm: float) -> int:
    """Write the PDF; return the number of its pages."""
    on_a_page = len(cells(side_mm))
    pages = [tag_numbers[first : first + on_a_page] for first in range(0, len(tag_numbers), on_a_page)]
    with PdfPages(path, metadata={'Title': f'tag36h11, {side_mm:g} mm', 'CreationDate': None}) as file:
        for page in pages:
            figure = draw_page(page, side_mm)
            file.savefig(figure)
            pyplot.close(figure)
    return len(pages)


def main(arguments: list[str] | None = None) -> int:
    """Write the PDF; exit code 2 if it cannot be written."""
    parser = Parser(prog='tags', description=(__doc__ or '').strip().splitlines()[0])
    side = number_type('a number in millimetres, such as 40', float)
    parser.add_argument('--side', type=side, default=100.0, metavar='MM', help='default: %(default)g')
    parser.add_argument('--tag-file', default='', metavar='FILE', help="default: the simulator's own")
    parser.add_argument('--output', type=Path, default=Path('.tags'), metavar='FOLDER')
    options = parser.parse_args(arguments)
    largest = (PAGE_MM[0] - 2 * MARGIN_MM) * MODULES / (MODULES + 2)
    try:
        if not 8.0 <= options.side <= largest:
            limits = f'between 8 and {largest:g} mm, the width of an A4 page'
            raise StartUpError(f'--side {options.side:g}: must be {limits}')
        tag_ids = list(require_layout(options.tag_file).tags)
        numbers = {str(number): number for number in range(TAG_COUNT)}
        if left_out := [tag_id for tag_id in tag_ids if tag_id not in numbers]:
            ids = f'ids are 0 to {TAG_COUNT - 1} in decimal'
            raise StartUpError(f'tag {left_out[0]!r} is not in tag36h11: {ids}')
        options.output.mkdir(parents=True, exist_ok=True)
        path = options.output / f'tag36h11-{options.side:g}mm.pdf'
        matplotlib.use('Agg')
        print(f'tags: drawing {pluralized(len(tag_ids), "tag")}', file=sys.stderr)
        pages = write(path, sorted(numbers[tag_id] for tag_id in tag_ids), options.side)
    except OneLineError as error:
        print(f'tags: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f"tags: --output '{options.output}': {error.strerror}: name a folder", file=sys.stderr)
        return 2
    print(f'{path}: {pluralized(len(tag_ids), "tag")} on {pluralized(pages, "page")}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
