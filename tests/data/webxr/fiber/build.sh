#!/bin/sh
# Builds main.jsx with the packages that it imports, from npm, into built/.
set -eu
cd "$(dirname "$0")"
mkdir -p built
cd built
[ -d node_modules ] || npm install --ignore-scripts --no-audit --no-fund --silent --prefix . \
  react@19.2.0 react-dom@19.2.0 three@0.181.0 @react-three/fiber@9.4.0 esbuild@0.28.2
NODE_PATH=node_modules node_modules/.bin/esbuild ../main.jsx --bundle --minify --jsx=automatic --format=esm \
  --outfile=main.js --define:process.env.NODE_ENV='"production"' --log-level=error
echo '<!doctype html><div id="root"></div><script type="module" src="main.js"></script>' >index.html
