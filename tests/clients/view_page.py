"""The page of `druse view` as a person uses it, in headless Chromium, from the disk.

    view_page.py druse [FOLDER]

A level set of three components is turned, cut, coloured, marked, picked, measured, hidden and saved as a picture; a
scaffold is cut element by element; keys and the link work, at 1280 x 720 and in the width of a tablet. Pixels and
places are compared with what the shapes are. The page makes no request. Screenshots go to FOLDER.
"""

import base64
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

RECIPE = """druse = 1
unit = "mm"
[band]
voxel_size = 0.4
[[op]]
union = { sphere = { radius = 8 } }
[[op]]
subtract = { sphere = { radius = 5 } }
[[op]]
union = { box = { centre = [21, 0, 0], size = [18, 12, 4] } }
[[output]]
vdb = "part.vdb"
"""


def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in ["headless=new", "no-sandbox", "disable-dev-shm-usage", "use-angle=swiftshader",
                 "enable-unsafe-swiftshader", "force-device-scale-factor=1"]:  # fmt: skip
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options, webdriver.ChromeService("/usr/bin/chromedriver"))


class Page:
    def __init__(self, driver, address, folder):
        self.driver, self.folder = driver, folder
        driver.get(address)
        WebDriverWait(driver, 60, 0.02).until(lambda d: self.script("return document.documentElement.dataset.ready"))
        self.canvas = self.element("canvas")

    def script(self, text, *arguments):
        return self.driver.execute_script(text, *arguments)

    def element(self, name):
        return self.driver.find_element(By.ID, name)

    def text(self, name):
        return self.element(name).get_attribute("textContent")

    def size(self, width, height):
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride",
                                    {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False})  # fmt: skip
        self.script("drawing.request()")

    def pixels(self):
        """The canvas as drawn: number of pixels of each colour, and the share of the background."""
        found = self.script(
            "drawing.draw(); const gl = drawing.gl, c = drawing.canvas, n = c.width * c.height, found = new Map();"
            "const p = new Uint32Array(n);"
            "gl.readPixels(0, 0, c.width, c.height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(p.buffer));"
            "for (const v of p) found.set(v, (found.get(v) ?? 0) + 1);"
            "return [[...found].sort((a, b) => b[1] - a[1]).slice(0, 4000), p[0], n];")  # fmt: skip
        colors, back, count = dict(found[0]), found[1], found[2]
        return colors, colors[back] / count

    def under(self, x, y):
        """Moves the pointer to a place counted from the middle of the canvas; the text that appears."""
        ActionChains(self.driver, 10).move_to_element_with_offset(self.canvas, x, y).perform()
        time.sleep(0.1)
        return self.text("under")

    def place(self, point):
        """Where a point of the part is on the canvas, from its middle."""
        return self.script(
            "const { view, projection } = drawing.camera.matrices(drawing.wide()), p = [...arguments[0], 1];"
            "const times = (m, v) => [0, 1, 2, 3].map((r) => m[r] * v[0] + m[4 + r] * v[1] + m[8 + r] * v[2] + m[12 + r] * v[3]);"
            "const c = times(projection, times(view, p));"
            "return [c[0] / c[3] * drawing.canvas.clientWidth / 2, -c[1] / c[3] * drawing.canvas.clientHeight / 2];",
            point)  # fmt: skip

    def keys(self, *keys):
        self.script("drawing.canvas.focus()")
        ActionChains(self.driver, 10).send_keys(*keys).perform()
        time.sleep(0.05)

    def slide(self, name, value):
        self.script("const s = document.getElementById(arguments[0]); s.value = arguments[1];"
                    "s.dispatchEvent(new Event('input', { bubbles: true }));", name, value)  # fmt: skip

    def shot(self, name):
        if self.folder:
            time.sleep(0.15)
            self.driver.save_screenshot(str(self.folder / f"{name}.png"))


def numbers(text):
    """The place in the text of the pointer."""
    return [float(n) for n in text.split("(")[1].split(")")[0].split(",")]


def work(page):
    page.size(1280, 720)
    assert page.text("title") == "part.vdb" and page.text("kind").startswith("level set, 38 × 16 × 16 mm"), page.text("kind")
    colors, back = page.pixels()
    assert len(colors) > 200 and 0.5 < back < 0.95, (len(colors), back)
    page.shot("plain")

    # Turned by a drag, by keys, and back home.
    before = page.pixels()[0]
    ActionChains(page.driver, 10).drag_and_drop_by_offset(page.canvas, 90, 40).perform()
    assert page.pixels()[0] != before, "a drag turns nothing"
    page.keys("h")
    assert page.pixels()[0] == before, "home is elsewhere"
    page.keys("+", "+", "+")
    assert page.pixels()[1] < back - 0.05, "plus comes no nearer"
    page.keys("h", "2")

    # From the right, at x = 30: the end of the plate is under the middle.
    x, y, z = numbers(page.under(*page.place([30, 0, 0])))
    assert abs(x - 30) < 0.1 and math.hypot(y, z) < 0.3, (x, y, z)

    # The cut at y = 0 from the front: the wall of the ball is filled, its cavity and the ground are not.
    page.keys("1", "y")
    page.slide("at", 500)
    assert page.element("cut").is_selected() and "y = 0 mm" in page.text("at-value"), page.text("at-value")
    assert "on the cut" in page.under(*page.place([0, 0, 6.5])), page.text("under")
    assert "on the cut" in page.under(*page.place([20, 0, 0]))
    text = page.under(*page.place([0, 0, 0]))
    assert "cut" not in text and "cavity 3" in text, text
    assert abs(math.dist(numbers(text), [0, 0, 0]) - 5) < 0.1, text
    assert page.under(*page.place([10, 0, 0])) == "", "something between the ball and the plate"
    # A mark and the distance from it.
    ActionChains(page.driver, 10).move_to_element_with_offset(page.canvas, *page.place([12.5, 0, 0])).click().perform()
    text = page.under(*page.place([29.5, 0, 0]))
    assert abs(float(text.split("\n")[-1].split()[0]) - 17) < 0.2, text
    page.shot("cut")
    page.keys("f")
    assert "y = 0 mm" in page.text("at-value") and page.under(*page.place([20, 0, 0])), "the other side is gone"
    page.keys("f")

    # Colours by wall thickness: 3 in the ball, 4 in the plate; what is below 3.5 is marked.
    Select(page.element("field")).select_by_index(1)
    assert page.element("legend").is_displayed() and "mm" in page.text("legend-name")
    assert abs(float(page.text("legend-low")) - 3) < 0.2 and abs(float(page.text("legend-high")) - 4) < 0.3
    page.keys("c", "h")
    text = page.under(*page.place([21, 0, 2]))
    assert abs(float(text.split("thickness: ")[1].split()[0]) - 4) < 0.3, text
    page.element("mark").send_keys("3.5")
    share = float(page.text("mark-share").split()[0])
    assert 50 < share < 90, share  # the ball's two faces of 1118 mm2, over the plate's 672
    page.shot("thickness")
    colors, _ = page.pixels()
    red = sum(n for c, n in colors.items() if c & 255 > 130 and c >> 8 & 255 < 90)
    assert red > 10_000, f"{red} pixels are marked"

    # Components: highlighted, hidden.
    Select(page.element("field")).select_by_visible_text("component")
    assert page.text("parts-title") == "2 components, 1 cavity", page.text("parts-title")
    rows = page.element("parts").find_elements(By.TAG_NAME, "div")
    before = page.pixels()[0]
    rows[1].find_element(By.TAG_NAME, "button").click()
    assert page.pixels()[0] != before, "nothing is highlighted"
    page.shot("component")
    rows[1].find_element(By.TAG_NAME, "button").click()
    rows[1].find_element(By.TAG_NAME, "input").click()
    assert page.under(*page.place([21, 0, 2])) == "", "the plate is still there"
    rows[1].find_element(By.TAG_NAME, "input").click()

    # Display, a picture, and the link.
    page.keys("b", "e", "d")
    assert all(page.element(n).is_selected() for n in ["box", "edges", "dark"])
    page.shot("dark")
    page.keys("d", "e", "b")
    png = base64.b64decode(page.driver.execute_async_script(
        "const done = arguments[0]; drawing.picture().then((b) => { const r = new FileReader();"
        "r.onload = () => done(r.result.split(',')[1]); r.readAsDataURL(b); });"))  # fmt: skip
    assert png.startswith(b"\x89PNG") and len(png) > 10_000, len(png)
    page.keys("z")
    page.slide("at", 250)
    time.sleep(0.4)
    link, text = page.driver.current_url, page.text("at-value")
    assert "cut=z" in link, link
    page.driver.get("about:blank")
    page.driver.get(link)
    WebDriverWait(page.driver, 20, 0.02).until(lambda d: page.script("return document.documentElement.dataset.ready"))
    page.canvas = page.element("canvas")
    assert page.text("at-value") == text and page.element("cut").is_selected(), page.text("at-value")

    # A tablet, upright: nothing overflows, all controls can be reached.
    page.size(768, 1024)
    wide = page.script("return [document.documentElement.scrollWidth, document.querySelector('aside').scrollWidth - document.querySelector('aside').clientWidth]")
    assert wide[0] <= 768 and wide[1] <= 0, wide
    page.shot("tablet")
    page.size(1280, 720)
    # Every control has a name for screen readers.
    tree = page.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    roles = {"button", "checkbox", "radio", "slider", "combobox", "textbox", "img", "image"}
    bare = [n["role"]["value"] for n in tree if not n.get("ignored") and n["role"]["value"] in roles and not n.get("name", {}).get("value")]
    assert not bare, bare
    drawn = page.script("drawing.draw(); return drawing.drawn")
    assert drawn["calls"] <= 6, drawn


def work_elements(page):
    page.size(1280, 720)
    assert page.text("kind").startswith("scaffold") and page.text("legend-name") == "quality", page.text("legend-name")
    page.shot("elements")
    before = page.pixels()[1]
    page.keys("x")
    page.slide("at", 500)
    assert page.pixels()[1] > before + 0.02, "no element is cut off"
    page.slide("shrink", 30)
    page.shot("elements_cut")
    middle = page.script("const b = drawing.body; return b.low.map((c, k) => c + b.size[k] / 2)")
    for _ in range(40):
        text = page.under(*page.place(middle))
        if text:
            break
        middle[2] -= page.script("return drawing.body.size[2]") / 60
    assert "quality: " in text and "element " in text, text


def main():
    druse = os.path.abspath(sys.argv[1])
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    bracket = Path(__file__).parents[2] / "examples/bracket/bracket.msh"
    with tempfile.TemporaryDirectory() as top:
        top = Path(top)
        (top / "r.toml").write_text(RECIPE)
        for arguments in [["run", "r.toml"], ["view", "part.vdb", "-o", "part.html"], ["view", bracket, "-o", "elements.html"]]:
            subprocess.run([druse, *arguments, "--quiet"], cwd=top, check=True, stdout=subprocess.DEVNULL)
        driver = browser()
        try:
            work(Page(driver, (top / "part.html").as_uri(), folder))
            work_elements(Page(driver, (top / "elements.html").as_uri(), folder))
            logs = [entry["message"] for entry in driver.get_log("browser")]
            assert not logs, logs
            sent = [e["message"] for e in driver.get_log("performance") if '"Network.requestWillBeSent"' in e["message"]]
            sent = [m for m in sent if not any(f'"url":"{s}' in m for s in ["file:", "data:", "blob:", "about:"])]
            assert not sent, sent
        finally:
            driver.quit()
    print("the page turns, cuts, colours, marks, picks and saves; nothing leaves the machine")


if __name__ == "__main__":
    main()
