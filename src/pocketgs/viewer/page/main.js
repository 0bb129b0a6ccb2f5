/**
 * The page: reads what there is to show, and puts its parts together.
 *
 * @module
 */

import { CaptureCameras } from "./capture_cameras.js";
import { PointerControls } from "./controls.js";
import { listenForFiles } from "./drop.js";
import { LiveRun } from "./live.js";
import { whileLoading } from "./loading.js";
import { hideMessage, showMessage, showPreviews, showWithoutGpu } from "./messages.js";
import { Renderer } from "./renderer.js";
import { SceneView } from "./scene_view.js";
import { fetchScene, readScene } from "./scene_file.js";
import { connectToolbar } from "./toolbar.js";

/** Up in scenes of which nothing is known, as trained from cameras whose y axis points down. */
const USUAL_UP = [0, -1, 0];

async function start() {
    const viewer = await fetchViewer();
    document.title = `${viewer.title} – PocketGS`;
    document.getElementById("title").textContent = viewer.title;
    // It comes while the shaders are compiled.
    const coming = viewer.scene && load(viewer);
    coming?.catch(() => {});
    const canvas = document.getElementById("canvas");
    let renderer;
    try {
        renderer = await Renderer.open(canvas, showMessage);
    } catch (error) {
        showWithoutGpu(error, viewer);
        if (viewer.live) {
            const onViewer = ({ previews }) => showPreviews(previews);
            new LiveRun({ onScene: () => {}, onViewer, onFault: showMessage });
        }
        return;
    }
    const view = new SceneView(canvas, renderer, { onStatistics: showStatistics, onFault: showMessage });
    const cameras = new CaptureCameras(view);
    new PointerControls(canvas, view.camera, () => cameras.stopComparing());
    connectToolbar(view, cameras, { title: viewer.title, onFault: showMessage });
    listenForFiles((file) => openFile(file, view, cameras));
    view.setBackground(viewer.background);
    cameras.setViews(viewer);
    if (viewer.live) {
        follow(view, cameras);
    }
    if (coming) {
        await showScene(await coming, viewer.up, view, cameras);
    }
}

async function fetchViewer() {
    const response = await fetch("viewer.json");
    if (!response.ok) {
        throw new Error(`viewer.json: the server answers ${response.status}`);
    }
    return response.json();
}

function load({ scene, title }) {
    return whileLoading(title, (onProgress) => fetchScene(scene.url, scene.bytes, onProgress));
}

async function showScene(gaussians, up, view, cameras) {
    await view.setScene(gaussians);
    if (!cameras.any) {
        cameras.frame(gaussians, up);
    }
}

async function openFile(file, view, cameras) {
    hideMessage();
    try {
        const read = (onProgress) => readScene(file.name, file.stream(), file.size, onProgress);
        const gaussians = await whileLoading(file.name, read);
        await view.setScene(gaussians);
        cameras.frame(gaussians, USUAL_UP);
        document.getElementById("title").textContent = file.name;
    } catch (error) {
        showMessage(error.message);
    }
}

function follow(view, cameras) {
    new LiveRun({
        onScene: (gaussians) => showScene(gaussians, USUAL_UP, view, cameras),
        onViewer: (viewer) => cameras.setViews(viewer),
        onFault: showMessage,
    });
}

function showStatistics(count, framesPerSecond) {
    const rate = framesPerSecond < 10 ? framesPerSecond.toFixed(1) : Math.round(framesPerSecond);
    document.getElementById("stats").textContent = `${count.toLocaleString("en")} splats · ${rate} fps`;
}

start().catch((error) => showMessage(error.message));
