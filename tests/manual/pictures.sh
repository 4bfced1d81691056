#!/bin/sh
# Creates the pictures of the manual again: drawings of the program, and its page in Chromium. Run it in the project's folder, after a build:
#   tests/manual/pictures.sh target/release/panelprep
set -eu

program=$(realpath "$1")
manual=$(realpath config/manual)
folder=$(mktemp -d)
trap 'kill $page 2>/dev/null; rm -rf "$folder"' EXIT
page=
cd "$folder"

"$program" render --seed 3 --reduction 2 --seconds 20 --out cell >/dev/null
files='--cell cell/cell.toml --recipe cell/recipe.toml'
teach="$files --scan cell/taught_scan.pcd --corner cell/taught_corner.png --flange cell/taught_flange.json"
"$program" teach $teach --pictures pictures >/dev/null
"$program" locate $files --scan cell/scan.pcd --out located.json >/dev/null
"$program" inspect $files --clip cell/clip --located located.json --pictures pictures >/dev/null || [ $? = 1 ]
cp pictures/taught.png pictures/inspected.png "$manual"

"$program" teach $teach --draw --listen 127.0.0.1:0 2>drawing.log >/dev/null &
page=$!
until address=$(grep -o 'http://[^ ]*' drawing.log); do sleep 0.1; done
chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --window-size=1200,720 --virtual-time-budget=5000 \
    --user-data-dir="$folder/browser" --screenshot="$manual/drawing.png" "$address" 2>/dev/null
ls -l "$manual"/*.png
