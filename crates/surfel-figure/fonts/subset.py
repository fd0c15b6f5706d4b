"""Makes Inter-Regular-subset.ttf of Inter-Regular.otf: subset.py SOURCE OUTPUT. Needs fonttools."""

import sys

from fontTools import subset
from fontTools.pens.cu2quPen import Cu2QuPen
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTFont, newTable

RANGES = [
    (0x20, 0x7E), (0xA0, 0x17F), (0x391, 0x3A9), (0x3B1, 0x3C9), (0x2010, 0x2015), (0x2018, 0x201E),
    (0x2070, 0x2079), (0x207A, 0x207B), (0x2080, 0x2089), (0x2190, 0x2193),
]
SIGNS = "†‡•…‰′″€™∂∆∑−√∞∫≈≠≤≥·◊Ω◯▲■●"
# Zero points, contours and instructions: `maxp` counts them anew.
COUNTS = (
    "maxZones maxTwilightPoints maxStorage maxFunctionDefs maxInstructionDefs maxStackElements maxSizeOfInstructions "
    "maxComponentElements maxPoints maxContours maxCompositePoints maxCompositeContours maxComponentDepth"
).split()


def main(source, output):
    options = subset.Options()
    options.layout_features, options.hinting, options.notdef_outline = [], False, True
    options.name_IDs = [0, 1, 2, 3, 4, 5, 6, 13, 14]
    options.drop_tables += ["GSUB", "GPOS", "GDEF", "DSIG", "STAT"]
    font = TTFont(source)
    subsetter = subset.Subsetter(options)
    letters = {code for first, last in RANGES for code in range(first, last + 1)}
    subsetter.populate(unicodes=letters | {ord(sign) for sign in SIGNS})
    subsetter.subset(font)
    outlines, order, glyphs = font.getGlyphSet(), font.getGlyphOrder(), {}
    for name in order:
        pen = TTGlyphPen(outlines)
        outlines[name].draw(Cu2QuPen(pen, 0.6, reverse_direction=True))
        glyphs[name] = pen.glyph()
    font["loca"], font["glyf"] = newTable("loca"), newTable("glyf")
    font["glyf"].glyphOrder, font["glyf"].glyphs = order, glyphs
    del font["CFF "]
    font["glyf"].compile(font)
    font["maxp"].tableVersion = 0x00010000
    for count in COUNTS:
        setattr(font["maxp"], count, 1 if count == "maxZones" else 0)
    font["post"].formatType = 3.0
    for name in order:
        glyph = glyphs[name]
        if glyph.numberOfContours:
            glyph.recalcBounds(font["glyf"])
        font["hmtx"][name] = (font["hmtx"][name][0], glyph.xMin if glyph.numberOfContours else 0)
    font.sfntVersion = "\000\001\000\000"
    font.save(output)


if __name__ == "__main__":
    main(*sys.argv[1:])
