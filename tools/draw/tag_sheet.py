"""
Make a PDF to print: the tag36h11 of each tag of the greenhouse, as many on an A4 page as fit.

    make tags SIDE=40                             .tags/tag36h11-40mm.pdf
    make tags SIDE=60 ARGS="--tag-file tags.json"

SIDE is the length of the black square in millimetres. Print at 100 % ("actual size") and check the ruler on
the page. Cut along the dashed lines: the white border is part of the tag.
"""

import argparse
import sys
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError, pluralized
from lupin_greenhouse_bridge.simulator.simulation import served_tag_ids
from lupin_simulation.tag36h11 import printed_marker
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline

PAGE_MM = (210.0, 297.0)  # A4
MARGIN_MM = 10.0  # printers do not print there
FOOTER_MM = 20.0  # the ruler
LABEL_MM = 7.0  # under each tag
TAG_COUNT = 587
MODULES = 8  # along a side of the black square; the white margin adds one on each side
RULER_MM = 100


def modules_of(tag_number: int) -> npt.NDArray[np.bool_]:
    """Return the tag as the AprilTag project draws it: True for black, row 0 on top."""
    modules: npt.NDArray[np.bool_] = printed_marker(tag_number) == 0
    return modules


def cells(side_mm: float) -> list[tuple[float, float]]:
    """Return the upper left corners of the cells of a page, row by row, in mm from its lower left corner."""
    width, height = cell_size(side_mm)
    columns = int((PAGE_MM[0] - 2 * MARGIN_MM) / width)
    rows = int((PAGE_MM[1] - 2 * MARGIN_MM - FOOTER_MM) / height)
    left, top = (PAGE_MM[0] - columns * width) / 2, PAGE_MM[1] - MARGIN_MM
    return [(left + column * width, top - row * height) for row in range(rows) for column in range(columns)]


def cell_size(side_mm: float) -> tuple[float, float]:
    """Return width and height of a tag with its white border and its label."""
    paper_mm = side_mm * (MODULES + 2) / MODULES
    return paper_mm, paper_mm + LABEL_MM


def draw_tag(axes: Axes, tag_number: int, side_mm: float, corner: tuple[float, float]) -> None:
    """Draw a tag, its label and its cutting line into the cell with this upper left corner."""
    modules = modules_of(tag_number)
    module_mm = side_mm / MODULES
    left, top = corner[0] + module_mm, corner[1] - module_mm
    squares = []
    for row, column in np.argwhere(modules):
        x, y = left + column * module_mm, top - (row + 1) * module_mm
        corners = [(x, y), (x + module_mm, y), (x + module_mm, y + module_mm), (x, y + module_mm), (x, y)]
        squares.append(Outline(corners, closed=True))
    # One shape, so that no viewer shows seams between its squares.
    axes.add_patch(PathPatch(Outline.make_compound_path(*squares), facecolor='black', linewidth=0))
    width, height = cell_size(side_mm)
    frame = corner[0], corner[1] - height
    axes.add_patch(Rectangle(frame, width, height, fill=False, edgecolor='0.6', linewidth=0.3, ls='--'))
    place = frame[0] + width / 2, frame[1] + 2.0
    axes.text(*place, f'id {tag_number}', ha='center', fontsize=min(12.0, side_mm / 3))


def draw_page(tag_numbers: list[int], side_mm: float) -> Figure:
    """Return one page; its coordinates are millimetres from the lower left corner."""
    figure = pyplot.figure(figsize=[side_mm / 25.4 for side_mm in PAGE_MM])
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, PAGE_MM[0]), ylim=(0, PAGE_MM[1]))
    axes.axis('off')
    for tag_number, corner in zip(tag_numbers, cells(side_mm), strict=False):
        draw_tag(axes, tag_number, side_mm, corner)
    for millimetre in range(RULER_MM + 1):
        length = 6.0 if millimetre % 10 == 0 else 4.0 if millimetre % 5 == 0 else 2.5
        x = (PAGE_MM[0] - RULER_MM) / 2 + millimetre
        axes.plot([x, x], [18.0, 18.0 + length], color='black', linewidth=0.3)
    text = f'tag36h11, black square {side_mm:g} mm. This ruler is {RULER_MM} mm long if printed at 100 %.'
    axes.text(PAGE_MM[0] / 2, 12.0, text, ha='center', fontsize=8)
    return figure


def write(path: Path, tag_numbers: list[int], side_mm: float) -> int:
    """Write the PDF; return the number of its pages."""
    on_one_page = len(cells(side_mm))
    firsts = range(0, len(tag_numbers), on_one_page)
    with PdfPages(path, metadata={'Title': f'tag36h11, {side_mm:g} mm', 'CreationDate': None}) as pages:
        for first in firsts:
            figure = draw_page(tag_numbers[first : first + on_one_page], side_mm)
            pages.savefig(figure)
            pyplot.close(figure)
    return len(firsts)


def main(arguments: list[str] | None = None) -> int:
    """Write the PDF; exit code 2 if it cannot be written."""
    parser = argparse.ArgumentParser(prog='tags', description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('--side', type=float, default=100.0, metavar='MM', help='default: %(default)g')
    parser.add_argument(
        '--tag-file', default='', metavar='FILE', help='default: the tag file that the simulator brings'
    )
    parser.add_argument('--output', type=Path, default=Path('.tags'), metavar='FOLDER')
    options = parser.parse_args(arguments)
    largest = (PAGE_MM[0] - 2 * MARGIN_MM) * MODULES / (MODULES + 2)
    try:
        if not 8.0 <= options.side <= largest:
            limits = f'must be between 8 and {largest:g} mm, the width of an A4 page'
            raise StartUpError(f'--side {options.side:g}: {limits}')
        tag_ids = served_tag_ids(options.tag_file)
        numbers = {str(number): number for number in range(TAG_COUNT)}
        if left_out := [tag_id for tag_id in tag_ids if tag_id not in numbers]:
            ids = f'0 to {TAG_COUNT - 1} in decimal'
            raise StartUpError(f'tag {left_out[0]!r} is not in tag36h11: ids are {ids}')
        options.output.mkdir(parents=True, exist_ok=True)
        path = options.output / f'tag36h11-{options.side:g}mm.pdf'
        matplotlib.use('Agg')
        pages = write(path, sorted(numbers[tag_id] for tag_id in tag_ids), options.side)
    except (OneLineError, OSError) as error:
        print(f'tags: {error}', file=sys.stderr)
        return 2
    print(f'{path}: {pluralized(len(tag_ids), "tag")} on {pluralized(pages, "page")}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
