//! The box with libcamera, whose virtual camera plays the scene.

use plumbline::config::{CaptureDriver, PixelFormat};

use crate::machine::{Host, Machine, Parts, image as built, is_measured, poses};
use crate::scene::{self, SCENE, distance_mm};

/// Of the scene's frames, so many; each is unpacked into memory twice, forwards and backwards.
const FRAMES: usize = 12;

const POSES: usize = 60;

/// libcamera unpacks JPEG with libjpeg's fast transform, which is off by one or two grey
/// levels in each block. The same transform moves the poses of these frames by up to
/// 0.9 mm; a picture that is cut, squeezed or sheared moves them by tens.
const DIFFERENCE_MM_MAX: f64 = 2.0;

/// The frames as an archive over the initramfs: `/frames/0.jpg` and so on.
fn pictures() -> Vec<u8> {
    let lens = SCENE.simulation.camera();
    let size = (u32::from(lens.width_px), u32::from(lens.height_px));
    let picture = |(place, frame)| {
        let mut pixels = Vec::new();
        SCENE.simulation.render(frame as u64, &mut pixels);
        let grey = image::GrayImage::from_raw(size.0, size.1, pixels).unwrap();
        let mut jpeg = Vec::new();
        // In colour: not every decoder takes a grey one.
        let colour = image::DynamicImage::ImageLuma8(grey).to_rgb8();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 100)
            .encode_image(&colour)
            .unwrap();
        (format!("frames/{place}.jpg"), jpeg)
    };
    scene::archive((0..FRAMES).chain((0..FRAMES).rev()).enumerate().map(picture))
}

#[test]
fn libcameras_virtual_camera_is_tracked() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let mut config = scene::config(host.address());
    let capture = config.capture.as_mut().unwrap();
    capture.driver = CaptureDriver::Libcamera;
    capture.device = "Virtual0".try_into().unwrap();
    capture.pixel_format = PixelFormat::Nv12;
    capture.rate_hz = 30.0;
    let disk = scene::boot_disk(directory.path(), &scene::blob(&config));
    let frames = directory.path().join("frames.cpio");
    std::fs::write(&frames, pictures()).unwrap();
    let parts = Parts {
        kernel: built("vmlinuz"),
        initramfs: vec![built("initramfs"), built("overlay-libcamera.cpio"), frames],
        command_line: "rdinit=/init",
        boot_disk: &disk,
        boot_disk_options: "",
        frames_disk: None,
        device_tree: None,
    };
    let machine = Machine::start(&parts, &host);
    // A Health comes every second, but on a busy machine it may be among the packets that were
    // dropped before there was a network.
    let health = machine.wait_for("poses and a Health after them", |seen| {
        let has_poses = poses(&seen.udp).filter(|pose| is_measured(pose)).count() >= POSES;
        seen.health().filter(|health| has_poses && health.frames >= POSES as u32).cloned()
    });
    assert_eq!(health.heap_allocations, Some(0));
    machine.look(|seen| {
        let mut largest_mm = [0.0_f64; 2];
        for pose in poses(&seen.udp).filter(|pose| is_measured(pose)) {
            for (target, largest_mm) in largest_mm.iter_mut().enumerate() {
                let found = pose.targets[target].pose.unwrap().translation_mm.map(f64::from);
                let offline = &SCENE.offline_mm[target][..FRAMES];
                let nearest = offline
                    .iter()
                    .map(|here| distance_mm(here, &found))
                    .fold(f64::INFINITY, f64::min);
                *largest_mm = largest_mm.max(nearest);
            }
        }
        println!("libcamera: at most {largest_mm:.4?} mm from the poses of these frames here");
        assert!(largest_mm.iter().all(|&mm| mm < DIFFERENCE_MM_MAX), "{largest_mm:?} mm");
    });
}
