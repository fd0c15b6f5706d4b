"""Runs every notebook of this folder anew, in a folder that is removed afterwards."""

import pathlib
import subprocess
import sys
import tempfile

here = pathlib.Path(__file__).parent
failed = 0
for notebook in sorted(here.glob("*.ipynb")):
    with tempfile.TemporaryDirectory() as folder:
        copy = pathlib.Path(folder) / notebook.name
        copy.write_bytes(notebook.read_bytes())
        words = ["-m", "nbconvert", "--to", "notebook", "--execute", "--inplace", "--log-level", "WARN", copy]
        done = subprocess.run([sys.executable, *words], cwd=folder, check=False)
        images = copy.read_text().count('"image/png"')
        print(f"{notebook.name}: {'ok' if done.returncode == 0 else 'FAILED'}, {images} images")
        # A notebook that shows nothing has failed, too.
        failed += done.returncode != 0 or images == 0
sys.exit(1 if failed else 0)
