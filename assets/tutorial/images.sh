#!/bin/sh
# Draws the images of the pages in docs/ that `cargo xtask gallery` doesn't draw. Run it at the root of the checkout,
# after `cargo xtask assets`, with the program in SURFEL (by default `surfel`). The images of GeoTIFF files also need
# Python with numpy, tifffile and imagecodecs.
set -eu
surfel=${SURFEL:-surfel}
images=docs/images
generated=assets/generated
village=$generated/village.copc.laz

draw() {
    "$surfel" "$@" --force
}

python3 assets/tutorial/village.py > $generated/village.txt
draw convert $generated/village.txt -o $village

# README and tutorial.
draw $generated/village.txt --classes '!7' --size 720x480 -o $images/village.png
draw $generated/part.obj --sharp --splats 960 --size 480x320 -o $images/part.png
draw $generated/spot-scan.xyz --size 480x480 -o $images/tutorial-scan.png
draw $generated/spot-scan.xyz --where 'x>0' --size 480x480 -o $images/tutorial-lying.png
draw $generated/spot-scan.xyz --where 'x>0' --up +y --size 480x480 -o $images/tutorial-upright.png
draw $generated/spot-scan.xyz --view 150,15 --color-by height --colorbar --background transparent --size 480x480 \
    -o $images/tutorial-figure.png
draw $generated/spot-scan.xyz --view 150,15 --frames 36 --turntable --frame-range 0-35:9 --size 240x240 \
    -o $images/'tutorial-turn-{frame}.png'

# Pages.
draw $village --classes '!7' --color-by classification --colorbar --size 480x320 -o $images/village-classes.png
draw $village --classes '!7' --color-by height --colorbar --size 480x320 -o $images/village-height.png
draw $village --size 480x320 -o $images/village-noise.png
draw $village --classes 2,9 --size 480x320 -o $images/village-ground.png
draw $village --classes '!7' --lod-error 8 --size 480x320 -o $images/lod-8.png
draw $village --classes '!7' --lod-error 1 --size 480x320 -o $images/lod-1.png
draw $generated/village.txt --columns x,y,z,_,_,_,_,_ --outliers drop --size 480x320 -o $images/village-plain.png
draw $generated/village.txt --columns x,y,z,_,_,_,_,_ --outliers drop --shader edl --size 480x320 \
    -o $images/village-edl.png
for tile in 0 1 2; do
    draw $village --classes '!7' --size 480x320 --tile $tile/3 -o $images/'tile-{tile}.png'
done
draw $generated/checkerboard.json --filter none --background 1,1,1 --size 480x240 -o $images/filter-none.png
draw $generated/checkerboard.json --background 1,1,1 --size 480x240 -o $images/filter-principal.png
for cull in none back; do
    draw $generated/spot-scan.xyz --where 'x>0' --up +y --view 250,15 --cull $cull --size 320x320 \
        -o $images/cull-$cull.png
done
for shader in unlit phong normal depth; do
    draw assets/spot/spot.obj --shader $shader --size 256x256 -o $images/shader-$shader.png
done
draw $generated/spot-scan.xyz --shader normal --size 320x320 -o $images/scan-normal.png
for scale in 0.4 1; do
    draw $generated/spot-scan.xyz --radius-scale $scale --size 320x320 -o $images/radius-scale-$scale.png
done
draw assets/spot/spot.obj --splats 3000 --size 320x320 -o $images/splats-3000.png
draw assets/spot/spot.obj --size 320x320 -o $images/splats-500000.png

folder=$(mktemp -d)

# The minimal splat file of docs/format.md.
sed -n '/^ply$/,/^```$/p' docs/format.md | grep -v '```' > "$folder/two.ply"
draw "$folder/two.ply" --view front --size 320x200 --no-metadata -o $images/two-disks.png

# Flat Gaussians of Spot.
draw convert assets/spot/spot.obj --splats 4000 --ascii -o "$folder/spot.ply"
python3 assets/tutorial/gaussians.py "$folder/spot.ply" > $generated/spot-gaussians.ply
draw $generated/spot-gaussians.ply --up +y --view 150,15 --size 320x320 -o $images/gaussians-over.png
draw $generated/spot-gaussians.ply --up +y --view 150,15 --size 320x320 --composite surface \
    -o $images/gaussians-surface.png

# GeoTIFF files, shown as PNG.
draw ortho $village --gsd 0.25 --crs EPSG:32633 -o "$folder/rgb.tif" --dsm "$folder/dsm.tif"
draw ortho $village --gsd 0.25 --crs EPSG:32633 --classes 2,9 --dsm "$folder/open.tif"
draw ortho $village --gsd 0.25 --crs EPSG:32633 --classes 2,9 --fill 8 --dsm "$folder/filled.tif"
python3 assets/tutorial/show_geotiff.py "$folder" $images
rm -r "$folder"
