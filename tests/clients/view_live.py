"""The live page of `druse view RECIPE` as a person uses it, in headless Chromium.

    view_live.py druse [FOLDER]

Sliders, switches and fields change the part; undo, redo and the link bring values back; what is computed is cancelled;
the recipe is saved and run; slices, cut, dark and keys work, at 1280 x 720 and in the width of a tablet. Volumes are
compared with closed forms. The page asks its own server only. Screenshots go to FOLDER.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait
from view_page import Page, browser

RECIPE = """# A hollow ball beside a block.
druse = 1
unit = "mm"
[band]
voxel_size = 0.2
[[op]]
union = { sphere = { centre = [20, 4, 4], radius = 5 } }
[[op]]
subtract = { sphere = { centre = [20, 4, 4], radius = "2mm" } }
[[op]]
union = { box = { centre = [4, 4, 4], size = [8, 8, 4] } } # the block
[[output]]
vdb = "part.vdb"
"""
BALL, HOLE, BLOCK = "op.0.union.sphere.radius", "op.1.subtract.sphere.radius", "op.2.union.box.size.2"


def volume(ball=5.0, hole=2.0, height=4.0):
    return 4 / 3 * math.pi * (ball**3 - hole**3) + 64 * height


class Live(Page):
    def until(self, true, seconds=120):
        return WebDriverWait(self.driver, seconds, 0.02).until(lambda _: true())

    def rest(self):
        """Waits for the last result; gives the volume that the page states."""
        self.until(lambda: self.script("return wanted === null && !isSending && !isFetching && document.documentElement.dataset.busy === 'no'"))
        self.until(lambda: self.script("return fetch('state').then((r) => r.json()).then((s) => !s.busy && s.number === shownNumber)"))
        assert self.element("error").get_attribute("hidden") is not None, self.text("error")
        facts = self.script("return Object.fromEntries(scene.facts)")
        return float(facts["volume"].split()[0])

    def field(self, key):
        return self.element(f"key-{key}")

    def slider(self, key):
        return self.driver.find_element(By.CSS_SELECTOR, f'[data-key="{key}"] input[type=range]')

    def drag(self, key, *values):
        """Moves a slider through values and lets it go."""
        for value in values:
            self.script("const s = arguments[0]; s.value = arguments[1]; s.dispatchEvent(new Event('input', { bubbles: true }));",
                        self.slider(key), value)  # fmt: skip
        self.script("arguments[0].dispatchEvent(new Event('change', { bubbles: true }))", self.slider(key))

    def write(self, key, text):
        field = self.field(key)
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys(str(text), Keys.ENTER)


def near(found, expected, share=0.03):
    assert abs(found / expected - 1) < share, (found, expected)


def start(druse, folder, *arguments):
    server = subprocess.Popen([druse, "view", *arguments], cwd=folder, stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL)
    return server, server.stdout.readline().strip()


def work(page, folder):
    page.size(1280, 720)
    assert page.text("title") == "part.toml" and page.text("kind").startswith("recipe"), page.text("kind")
    near(page.rest(), volume())
    assert "full run" in page.text("estimate") and "voxels" in page.text("status"), page.text("status")
    assert page.field(BALL).get_attribute("value") == "5" and "mm" in page.driver.find_element(By.CSS_SELECTOR, f'[data-key="{HOLE}"]').text
    page.shot("live")
    triangles = page.script("return drawing.body.triangles.length")

    # A slider through many values: the last one is shown; the first answer comes soon.
    number = page.script("return shownNumber")
    before = time.monotonic()
    page.drag(BALL, 5.5, 6, 6.5, 7)
    page.until(lambda: page.script("return shownNumber") > number)
    answered = time.monotonic() - before
    near(page.rest(), volume(ball=7))
    assert page.script("return drawing.body.triangles.length") > triangles
    camera = page.script("return drawing.camera.text()")
    page.write(HOLE, 3)
    near(page.rest(), volume(ball=7, hole=3))
    page.write(BLOCK, 6)
    near(page.rest(), volume(ball=7, hole=3, height=6))

    # Undo and redo, by buttons and keys, and the values of the file.
    page.element("undo").click()
    near(page.rest(), volume(ball=7, hole=3))
    ActionChains(page.driver).key_down(Keys.CONTROL).send_keys("z").key_up(Keys.CONTROL).perform()
    near(page.rest(), volume(ball=7))
    ActionChains(page.driver).key_down(Keys.CONTROL).send_keys("y").key_up(Keys.CONTROL).perform()
    near(page.rest(), volume(ball=7, hole=3))
    page.element("redo").click()
    near(page.rest(), volume(ball=7, hole=3, height=6))
    assert not page.element("redo").is_enabled()
    page.element("reset").click()
    near(page.rest(), volume())
    page.element("undo").click()
    near(page.rest(), volume(ball=7, hole=3, height=6))

    # An operation off and on.
    page.element("op-1").click()
    near(page.rest(), volume(ball=7, hole=0, height=6))
    page.element("op-1").click()
    near(page.rest(), volume(ball=7, hole=3, height=6))

    # The second operation first: nothing is there to subtract from.
    mover = page.driver.find_element(By.CSS_SELECTOR, '[data-section="op.1"] .mover')
    mover.click()
    sections = [f.get_attribute("data-section") for f in page.driver.find_elements(By.CSS_SELECTOR, '[data-section^="op."]')]
    assert sections[:2] == ["op.1", "op.0"], sections
    page.element("undo").click()
    near(page.rest(), volume(ball=7, hole=3, height=6))

    # A key that the recipe lacks is added, and removed again.
    adder = Select(page.driver.find_element(By.CSS_SELECTOR, '[aria-label="add a key to band"]'))
    adder.select_by_value("band.half_width")
    row = page.driver.find_element(By.CSS_SELECTOR, '[data-key="band.half_width"]')
    assert row.is_displayed() and "half_width = 3" in page.driver.execute_async_script(
        "const done = arguments[0]; ask('recipe').then((r) => r.text()).then(done)")
    near(page.rest(), volume(ball=7, hole=3, height=6))
    row.find_element(By.CLASS_NAME, "mover").click()
    assert not row.is_displayed()
    near(page.rest(), volume(ball=7, hole=3, height=6))

    # A wrong value is reported beside its key, and the part stays.
    page.write(BALL, -1)
    row = page.driver.find_element(By.CSS_SELECTOR, f'[data-key="{BALL}"] .warning')
    page.until(lambda: "positive" in row.get_attribute("textContent"))
    assert row.is_displayed()
    page.shot("wrong")
    page.element("undo").click()
    page.rest()
    assert not row.is_displayed()

    # The camera stays while values change; cut, slice and keys.
    assert page.script("return drawing.camera.turn") == float(camera.split(",")[0])
    page.keys("y")
    page.slide("at", 500)
    page.keys("s")
    page.until(lambda: "solid" in page.script("return slice.text.textContent"))
    solid = float(page.script("return slice.text.textContent").split("solid ")[1].split()[0])
    assert solid > math.pi * (49 - 9), solid
    spot = page.script("const { low, step, width, height } = slice.about, b = slice.canvas.getBoundingClientRect();"
                       "return [((25 - low[0]) / step / width - 0.5) * b.width, (0.5 - (4 - low[1]) / step / height) * b.height]")  # fmt: skip
    ActionChains(page.driver, 10).move_to_element_with_offset(page.script("return slice.canvas"), *spot).perform()
    value = page.script("return slice.text.textContent").split(": ")[1].split()[0]
    # (25, 4, 4) lies 5 from the middle, between walls at 3 and 7; beyond the band values do not change.
    assert -2.2 < float(value) < -0.2, value
    page.shot("slice")
    page.keys("d")
    assert page.script("return document.documentElement.className") == "dark"
    page.shot("live_dark")
    page.keys("d")

    # The link restores values, camera and cut.
    ActionChains(page.driver, 10).drag_and_drop_by_offset(page.canvas, 60, 30).perform()
    time.sleep(0.5)
    link, kept = page.driver.current_url, page.script("return drawing.camera.text()")
    assert "set=" in link and "cut=y" in link, link
    page.driver.get("about:blank")
    page = Live(page.driver, link, page.folder)
    near(page.rest(), volume(ball=7, hole=3, height=6))
    assert page.element("cut").is_selected() and page.field(BALL).get_attribute("value") == "7"
    near(float(page.script("return drawing.camera.text()").split(",")[0]), float(kept.split(",")[0]), 1e-3)

    # Cancel: the last result stays.
    shown = page.script("return shownNumber")
    page.write("band.voxel_size", 0.03)
    page.until(lambda: page.script("return shownNumber") > shown)
    page.element("cancel").click()
    page.until(lambda: page.script("return document.documentElement.dataset.busy") == "no", 60)
    page.element("undo").click()
    page.rest()

    # Saved beside the recipe, never over a file; then the full run with its files.
    page.element("save").find_element(By.TAG_NAME, "button").click()
    page.until(lambda: "saved" in page.text("full"))
    made = (folder / "part_2.toml").read_text()
    assert made == RECIPE.replace("radius = 5 ", "radius = 7 ").replace('"2mm"', '"3mm"').replace("8, 8, 4]", "8, 8, 6]"), made
    page.element("save").find_element(By.TAG_NAME, "button").click()
    page.until(lambda: "exists already" in page.text("error"))
    page.element("run").click()
    page.until(lambda: "part.vdb" in page.text("full"))
    assert (folder / "part.vdb").stat().st_size > 10_000

    # A tablet's width: nothing overflows; every control has a name.
    for width, height in [(820, 1180), (1280, 720)]:
        page.size(width, height)
        wide = page.script("const a = document.querySelector('aside'); return [document.documentElement.scrollWidth, a.scrollWidth - a.clientWidth]")
        assert wide[0] <= width and wide[1] <= 0, (width, wide)
        page.shot(f"live_{width}")
    tree = page.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    roles = {"button", "checkbox", "radio", "slider", "combobox", "textbox", "img", "image", "progressbar"}
    bare = [n["role"]["value"] for n in tree if not n.get("ignored") and n["role"]["value"] in roles and not n.get("name", {}).get("value")]
    assert not bare, bare
    drawn = page.script("drawing.draw(); return drawing.drawn")
    assert drawn["calls"] <= 6 and drawn["triangles"] <= 3 * 420_000, drawn
    return answered


HIDDEN = """druse = 1
unit = "mm"
[cell.p]
surface = "schwarz_p"
volume_fraction = 0.3
[scaffold]
box = { size = [10, 10, 10], cell_size = 5 }
[tiling]
cell = "p"
[band]
voxel_size = 0.4
[[op]]
union = { skin = { mesh = "cube.stl", thickness = 1 } }
"""


def cube(path, edge):
    """Writes a cube as .stl."""
    faces = []
    for a in range(3):
        for side in (0, edge):
            square = [(0, 0), (edge, 0), (edge, edge), (0, edge)][:: 1 if side else -1]
            corner = [[p[(k - a) % 3] for k in range(3)] for p in ([side, *q] for q in square)]
            faces += [(corner[0], corner[1], corner[2]), (corner[0], corner[2], corner[3])]
    lines = ["facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in f) + "endloop\nendfacet\n" for f in faces]
    path.write_text("solid cube\n" + "".join(lines) + "endsolid cube\n")


def opens_cut(driver, druse, folder):
    """A lattice under a skin is seen at once, without the edges of its scaffold; labels stand under their group."""
    cube(folder / "cube.stl", 10)
    (folder / "hidden.toml").write_text(HIDDEN)
    server, address = start(druse, folder, "hidden.toml")
    try:
        page = Live(driver, address, None)
        page.rest()
        assert page.element("cut").is_selected() and not page.element("edges").is_selected()
        groups = [g.text for g in driver.find_elements(By.CSS_SELECTOR, '[data-section="op.0"] .group')]
        assert groups == ["skin"], groups
    finally:
        server.kill()


def weight(address):
    """Bytes of the page without data."""
    return sum(len(urllib.request.urlopen(address + name).read()) for name in ["", "page.css", "page.js"])


def main():
    druse = os.path.abspath(sys.argv[1])
    folder = Path(sys.argv[2]).absolute() if len(sys.argv) > 2 else None
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as top:
        top = Path(top)
        (top / "part.toml").write_text(RECIPE)
        server, address = start(druse, top, "part.toml")
        driver = browser()
        try:
            size = weight(address)
            assert size < 1_500_000, size
            before = time.monotonic()
            page = Live(driver, address, folder)
            first = time.monotonic() - before
            answered = work(page, top)
            expected = ("422", "409")  # a wrong value; a name that exists
            logs = [e["message"] for e in driver.get_log("browser") if not any(f"status of {s}" in e["message"] for s in expected)]
            assert not logs, logs
            sent = [json.loads(e["message"])["message"] for e in driver.get_log("performance")]
            urls = [m["params"]["request"]["url"] for m in sent if m["method"] == "Network.requestWillBeSent"]
            foreign = [u for u in urls if not u.startswith((address, "data:", "blob:", "about:"))]
            assert urls and not foreign, foreign
            urllib.request.urlopen(address + "quit", b"")
            assert server.wait(5) == 0
            opens_cut(driver, druse, top)
        finally:
            driver.quit()
            server.kill()
    print(f"the live page changes, undoes, slices, saves and runs; {size} bytes, first picture {first:.2f} s, first answer {answered:.2f} s")


if __name__ == "__main__":
    main()
