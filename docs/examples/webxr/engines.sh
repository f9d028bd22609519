#!/bin/sh
# Gets the engines of the example pages from npm, as the addresses in the pages name them, and IWER,
# which emulates a headset in tests; the pages are then played with
# --map https://cdn.jsdelivr.net/npm/=docs/examples/webxr/engines
set -eu
cd "$(dirname "$0")"
for package in three@0.187.0 aframe@1.8.0 babylonjs@9.34.0 iwer@2.5.0; do
  [ -f "engines/$package/package.json" ] && continue
  mkdir -p "engines/$package"
  file=$(npm pack --silent "$package")
  tar -xzf "$file" -C "engines/$package" --strip-components 1
  rm "$file"
done
