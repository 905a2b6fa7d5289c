"""`druse crystal --view` as a person uses it, in headless Chromium, and as nobody may use it.

    viewer.py druse [PICTURE.png]

The model is drawn, the face under the pointer lights up, a click extrudes it, sliders change what was done, groups are
extruded, remeshing, undo and redo work, what is saved replays to the same model. A wrong token, another host's name and
paths out of the directory are refused.
"""

import http.client
import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.parse
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

SCRIPT = "# A brick with a lid.\nparam height = 1/2\nprism n=4 edge=1 height=height\nassign top 2\n"


def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in ["headless=new", "no-sandbox", "disable-dev-shm-usage", "use-angle=swiftshader",
                 "enable-unsafe-swiftshader", "window-size=1200,800", "force-device-scale-factor=1"]:  # fmt: skip
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options, webdriver.ChromeService("/usr/bin/chromedriver"))


class Page:
    def __init__(self, driver, address):
        self.driver = driver
        driver.get(address)
        self.until(lambda: "vertices" in self.text("summary"))
        self.canvas = driver.find_element(By.ID, "canvas")

    def until(self, true, seconds=10):
        return WebDriverWait(self.driver, seconds, 0.05).until(lambda _: true())

    def element(self, name):
        return self.driver.find_element(By.ID, name)

    def text(self, name):
        return self.element(name).get_attribute("textContent")

    def counts(self):
        words = self.text("summary").split()
        return int(words[0]), int(words[4])  # vertices and faces

    def volume(self):
        return float(self.text("summary").split("volume ")[1].split(",")[0])

    def changes(self, act):
        """Waits for the model that an act makes; gives its counts."""
        before = self.text("summary"), self.text("script")
        act()
        self.until(lambda: (self.text("summary"), self.text("script")) != before)
        return self.counts()

    def point(self, x, y):
        """Moves the pointer to a place counted from the middle of the canvas."""
        ActionChains(self.driver, 20).move_to_element_with_offset(self.canvas, x, y).perform()
        time.sleep(0.1)
        return self.text("under")

    def slide(self, name, value):
        self.driver.execute_script(
            "const s = document.querySelector(arguments[0]); s.value = arguments[1];"
            "s.dispatchEvent(new Event('input', { bubbles: true }));", name, value)  # fmt: skip

    def colors(self):
        """How many pixels of the canvas have which colour."""
        return dict(self.driver.execute_script(
            "drawing.draw(); const gl = drawing.gl, n = drawing.canvas.width * drawing.canvas.height;"
            "const p = new Uint32Array(n), found = new Map();"
            "gl.readPixels(0, 0, drawing.canvas.width, drawing.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(p.buffer));"
            "for (const c of p) found.set(c, (found.get(c) ?? 0) + 1); return [...found];"))  # fmt: skip


def ask(address, path, body=None, host=None):
    """A bare request; gives status and text."""
    url = urllib.parse.urlsplit(address)
    connection = http.client.HTTPConnection(url.hostname, url.port, timeout=10)
    headers = {"Host": host} if host else {}
    connection.request("GET" if body is None else "POST", path, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode(errors="replace")


def work(page, folder, druse):
    colors = page.colors()
    assert len(colors) > 20, f"{len(colors)} colours: nothing is drawn"
    white = max(colors.values()) / sum(colors.values())
    assert white < 0.95, f"{white:.0%} of the picture is one colour"
    assert page.counts() == (8, 6), page.counts()
    # Two faces show, each in one shade of its group's colour, on white.
    main = sorted(colors.values())[-3:]
    assert min(main) > 5000 and sum(main) > 0.97 * sum(colors.values()), main

    assert page.point(0, 0).startswith("face "), "no face under the middle of the picture"
    lit = page.colors()
    assert lit != colors, "the face under the pointer does not light up"
    page.point(-400, -300)
    assert page.text("under") == "" and page.colors() == colors, "the light stays on"

    # A click: a quad becomes a prism on its place. Its sliders change it after the fact.
    middle = lambda: ActionChains(page.driver, 20).move_to_element_with_offset(page.canvas, 0, 0).click().perform()
    assert page.changes(middle) == (12, 10)
    straight = page.volume()
    page.element("regular").click()
    page.changes(lambda: page.slide("#dihedral", 70))
    assert page.counts() == (12, 10) and page.volume() < straight
    page.changes(lambda: page.slide("#iterations", 2))
    assert page.counts() == (16, 14)
    page.changes(lambda: page.slide("#tiers input", 0.5))
    said = page.text("script")
    assert said.startswith(SCRIPT) and "dihedral=70 tiers=[0.5] iterations=2" in said, said

    # The whole group, remeshing, any step, and back and forth.
    page.element("whole").click()
    Select(page.element("kind")).select_by_value("octahedral")
    assert "group" in page.point(0, 0)
    before = page.counts()
    page.changes(middle)
    assert page.counts()[1] > before[1] + 8, page.counts()
    Select(page.element("scheme")).select_by_value("checkerboard")
    vertices = page.changes(page.element("remesh").click)[0]
    assert vertices > 100
    page.element("step").send_keys("symmetrize")
    grouped = page.changes(page.element("any").find_element(By.TAG_NAME, "button").click)
    script = page.text("script")
    assert script.rstrip().endswith("symmetrize")
    for _ in range(3):
        page.changes(page.element("undo").click)
    for _ in range(3):
        page.changes(page.element("redo").click)
    assert page.counts() == grouped and page.text("script") == script
    page.element("step").clear()
    page.element("step").send_keys("extrud all")
    page.element("any").find_element(By.TAG_NAME, "button").click()
    page.until(lambda: "did you mean" in page.text("message"))

    # What is saved replays to what is shown.
    for name in ["made.crystal", "made.obj"]:
        page.element("name").clear()
        page.element("name").send_keys(name)
        page.element("keep").find_element(By.TAG_NAME, "button").click()
        page.until(lambda: name in page.text("message"))
        made = subprocess.run([druse, "crystal", folder / name, "--json"], capture_output=True, check=True)
        facts = json.loads(made.stdout)
        assert (facts["vertices"], facts["faces"]) == grouped, facts
        # The page shows four significant digits.
        assert abs(facts["volume"] / page.volume() - 1) < 5e-4
    assert (folder / "made.crystal").read_text() == script
    # Steps of the opened script can be undone, too; then the script is its steps, with the parameters.
    while page.element("undo").is_enabled() and "assign" in page.text("script"):
        page.changes(page.element("undo").click)
    assert page.text("script") == "param height = 0.5\nprism n=4 edge=1 height=height\n", page.text("script")
    page.changes(page.element("redo").click)
    page.until(lambda: page.text("script") == SCRIPT)


def refuse(address, folder):
    path = urllib.parse.urlsplit(address).path
    wrong = path.replace(path[1:3], "zz", 1)
    for asked in ["/", wrong, wrong + "model", path + "nothing", "/favicon.ico", path.rstrip("/") + "x/model"]:
        status, said = ask(address, asked)
        assert status in (403, 404) and "vertices" not in said, (asked, status)
    assert ask(address, wrong + "step", "cube")[0] == 403
    for host in ["evil.example", "evil.example:80", "127.0.0.1:1"]:
        assert ask(address, path + "model", host=host)[0] == 403, host
    outside = folder.parent / "outside.obj"
    (folder / "link.obj").symlink_to(outside)
    bad = ["../outside.obj", "/outside.obj", "sub/outside.obj", "..", ".hidden.obj", "", "link.obj", "a\\b.obj", "a\nb.obj"]
    for name in bad:
        status, said = ask(address, path + "save", name)
        assert status == 403, (name, status, said)
    for step in ["save ../outside.obj", "load ../outside.obj", "load link.obj", "save link.obj", "cube; extrude cubical group=9"]:
        status, said = ask(address, path + "step", step)
        assert status == 422 and "expected" in said or "selects none" in said, (step, status, said)
    assert ask(address, path + "save", "model.exe")[0] == 422
    assert ask(address, path + "step", "#" * 100_000)[0] == 413
    assert ask(address, path + "step", b"\xff\xfe")[0] == 400
    assert not outside.exists() and not (folder / "sub").exists()


def main():
    druse = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "models"
        folder.mkdir()
        (folder / "brick.crystal").write_text(SCRIPT)
        server = subprocess.Popen([druse, "crystal", folder / "brick.crystal", "--view"], stdout=subprocess.PIPE, text=True)
        driver = browser()
        try:
            address = server.stdout.readline().strip()
            page = Page(driver, address)
            work(page, folder, druse)
            refuse(address, folder)
            if len(sys.argv) > 2:
                ask(address, urllib.parse.urlsplit(address).path + "step", "extrude dodecahedral all tiers=[.5, .7, .5]")
                page = Page(driver, address)
                page.point(0, 40)
                driver.save_screenshot(sys.argv[2])
            logs = [entry["message"] for entry in driver.get_log("browser") if "422" not in entry["message"]]
            assert not logs, logs
            assert ask(address, urllib.parse.urlsplit(address).path + "quit", "")[0] == 200
            assert server.wait(5) == 0
        finally:
            driver.quit()
            server.kill()
    print("the viewer draws, lights up, extrudes, undoes and saves; strangers are refused")


main()
