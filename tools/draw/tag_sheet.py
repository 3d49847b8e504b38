"""
A PDF to print: one page for each tag that the simulator loads, with the tag36h11 of that number.

    make tags SIDE=100                            .tags/tag36h11-100mm.pdf
    make tags SIDE=60 ARGS="--tag-file tags.json"

SIDE is the length of the black square in millimetres. Print at 100 % ("actual size"), and lay a ruler to the
one on the page.
"""

import argparse
import sys
from pathlib import Path

import matplotlib
import numpy as np
from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.simulation import served_tag_ids
from lupin_perception import scene
from matplotlib import pyplot
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

PAGE_MM = (210.0, 297.0)  # A4
MARGIN_MM = 10.0  # printers leave it white
TAG_COUNT = 587
RULER_MM = 100
CENTRE_MM = (PAGE_MM[0] / 2, 170.0)


def modules_of(tag_number: int) -> np.ndarray:
    """Return the tag as the AprilTag project draws it: True where it is black, row 0 on top."""
    return np.rot90(scene.marker(tag_number), 2) == 0  # OpenCV has the family upside down


def draw_page(tag_number: int, side_mm: float):
    """Return one page; everything on it is in millimetres from the lower left corner."""
    figure = pyplot.figure(figsize=[each / 25.4 for each in PAGE_MM])
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, PAGE_MM[0]), ylim=(0, PAGE_MM[1]))
    axes.axis('off')
    modules = modules_of(tag_number)
    module_mm = side_mm / len(modules)
    left, top = CENTRE_MM[0] - side_mm / 2, CENTRE_MM[1] + side_mm / 2
    squares = []
    for row, column in np.argwhere(modules):
        x, y = left + column * module_mm, top - (row + 1) * module_mm
        corners = [(x, y), (x + module_mm, y), (x + module_mm, y + module_mm), (x, y + module_mm), (x, y)]
        squares.append(Outline(corners, closed=True))
    # One shape, so that no viewer shows seams between its squares.
    axes.add_patch(PathPatch(Outline.make_compound_path(*squares), facecolor='black', linewidth=0))
    axes.text(
        CENTRE_MM[0],
        25.0,
        f'tag36h11   id {tag_number}   black square {side_mm:g} mm, white margin {module_mm:g} mm',
        ha='center',
        fontsize=12,
    )
    for millimetre in range(RULER_MM + 1):
        length = 6.0 if millimetre % 10 == 0 else 4.0 if millimetre % 5 == 0 else 2.5
        x = (PAGE_MM[0] - RULER_MM) / 2 + millimetre
        axes.plot([x, x], [40.0, 40.0 + length], color='black', linewidth=0.3)
    axes.text(CENTRE_MM[0], 34.0, f'{RULER_MM} mm, if printed at 100 %', ha='center', fontsize=8)
    return figure


def write(path: Path, tag_numbers: list[int], side_mm: float) -> None:
    """Write the PDF, one page for each tag."""
    with PdfPages(path, metadata={'Title': f'tag36h11, {side_mm:g} mm', 'CreationDate': None}) as pages:
        for tag_number in tag_numbers:
            figure = draw_page(tag_number, side_mm)
            pages.savefig(figure)
            pyplot.close(figure)


def main(arguments: list[str] | None = None) -> int:
    """Write the PDF; exit code 2 when it cannot be."""
    parser = argparse.ArgumentParser(prog='tags', description=__doc__.strip().splitlines()[0])
    parser.add_argument('--side', type=float, default=100.0, metavar='MM', help='default: %(default)g')
    parser.add_argument('--tag-file', default='', metavar='FILE', help="default: the simulator's own")
    parser.add_argument('--output', type=Path, default=Path('.tags'), metavar='FOLDER')
    options = parser.parse_args(arguments)
    largest = (PAGE_MM[0] - 2 * MARGIN_MM) / (1 + 2 / 8)  # with a white margin of one module
    try:
        if not 8.0 <= options.side <= largest:
            raise StartUpError(
                f'--side {options.side:g}: give 8 to {largest:g} mm, which an A4 page has room for'
            )
        tag_ids = served_tag_ids(options.tag_file)
        numbers = [
            int(each) for each in tag_ids if each.isascii() and each.isdecimal() and int(each) < TAG_COUNT
        ]
        if left_out := [each for each in tag_ids if str(each) not in map(str, numbers)]:
            raise StartUpError(
                f'tag {left_out[0]!r} has no tag36h11: ids are 0 to {TAG_COUNT - 1} in decimal'
            )
        options.output.mkdir(parents=True, exist_ok=True)
        path = options.output / f'tag36h11-{options.side:g}mm.pdf'
        matplotlib.use('Agg')
        write(path, sorted(numbers), options.side)
    except (OneLineError, OSError) as error:
        print(f'tags: {error}', file=sys.stderr)
        return 2
    print(f'{path}: {len(numbers)} tags')
    return 0


if __name__ == '__main__':
    sys.exit(main())
