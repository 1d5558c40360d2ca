//! Animated PNGs: the numbered pictures in one file, with the times of their frames.

use std::io::Cursor;

use crate::support::Folder;

/// Every frame of an animation: its pixels, and how long it is shown [s].
fn frames_of(bytes: Vec<u8>) -> (Vec<Vec<u8>>, Vec<f64>, png::Info<'static>) {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let control = reader.info().animation_control.expect("an animation");
    assert_eq!(control.num_plays, 0, "for ever");
    let (mut pixels, mut delays) = (Vec::new(), Vec::new());
    for _ in 0..control.num_frames {
        let mut picture = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut picture).unwrap();
        picture.truncate(info.buffer_size());
        let shown = reader.info().frame_control.expect("a delay");
        pixels.push(picture);
        delays.push(f64::from(shown.delay_num) / f64::from(shown.delay_den));
    }
    let info = reader.info().clone();
    (pixels, delays, info)
}

#[test]
fn an_animation_holds_the_numbered_pictures_and_their_times() {
    let folder = Folder::with_run();
    let times = yawara::store::RunReader::open(&folder.path("run")).unwrap().times().to_vec();
    assert_eq!(times.len(), 5);
    let slice = ["slice", "run", "--axis", "z", "--at", "0", "--frame", "all", "--pixel", "1"];
    let solid = ["render", "run", "--frame", "all", "--size", "96x80"];
    let clear = ["render", "run", "--frame", "all", "--size", "96x80", "--background", "transparent"];
    for (call, bytes_per_pixel) in [(slice.as_slice(), 3), (&solid, 3), (&clear, 4)] {
        folder.yawara(&[call, &["-o", "n_{frame}.png"]].concat()).done();
        let told = folder.yawara(&[call, &["-o", "a.apng", "--slow", "20", "--threads", "1"]].concat()).done();
        assert_eq!((told.stdout.as_str(), told.stderr.as_str()), ("a.apng\n", ""));
        folder.yawara(&[call, &["-o", "b.apng", "--slow", "20", "--threads", "3"]].concat()).done();
        assert!(folder.read("a.apng") == folder.read("b.apng"), "{call:?}: bytes depend on the threads");
        let (frames, delays, info) = frames_of(folder.read("a.apng"));
        assert_eq!((frames.len(), info.bytes_per_pixel()), (5, bytes_per_pixel), "{call:?}");
        assert!(frames.windows(2).any(|pair| pair[0] != pair[1]));
        for (number, frame) in frames.iter().enumerate() {
            let still = image::load_from_memory(&folder.read(&format!("n_{number}.png"))).unwrap();
            let still = if bytes_per_pixel == 4 { still.to_rgba8().into_raw() } else { still.to_rgb8().into_raw() };
            assert!(*frame == still, "{call:?}, frame {number}");
        }
        for (number, delay) in delays.iter().enumerate() {
            let next = number.min(3);
            let expected = 20.0 * (times[next + 1] - times[next]);
            assert!((delay - expected).abs() <= 1.01e-4, "frame {number} is shown for {delay} s, not {expected}");
        }
        if call[0] == "slice" {
            assert_eq!(info.pixel_dims.map(|size| size.xppu), Some(1000), "pixels of 1 mm");
        }
    }
    // From a file with frames of its own, with the times it holds.
    folder.yawara(&["mesh", "run", "-o", "all.glb", "--frame", "all"]).done();
    folder.yawara(&["render", "all.glb", "-o", "g.apng", "--frame", "all", "--size", "48x48"]).done();
    let (frames, delays, _) = frames_of(folder.read("g.apng"));
    assert!(frames.len() == 5 && (delays[1] - (times[2] - times[1])).abs() <= 1.01e-4, "{delays:?}");
}

#[test]
fn names_that_do_not_fit_are_refused_and_leave_nothing() {
    let folder = Folder::with_run();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    let refused = |call: &[&str], parts: &[&str]| {
        folder.yawara(call).refused(parts);
        assert!(!folder.path("a.apng").exists() && !folder.path("a_0.apng").exists(), "{call:?}");
    };
    for way in [["slice", "run", "--axis", "z", "--at", "0"].as_slice(), &["render", "run", "--size", "48x48"]] {
        refused(
            &[way, &["-o", "a_{frame}.apng", "--frame", "all"]].concat(),
            &["a_{frame}.apng", "in one file", ".png"],
        );
        refused(&[way, &["-o", "a.apng"]].concat(), &["a.apng", "--frame all"]);
        refused(&[way, &["-o", "a.gif", "--frame", "all"]].concat(), &["a.gif", ".png", ".apng"]);
        for slow in ["0", "-1", "nan", "inf"] {
            refused(&[way, &["-o", "a.apng", "--frame", "all", "--slow", slow]].concat(), &["--slow is", "above 0"]);
        }
        refused(&[way, &["-o", "a.apng", "--frame", "all", "--slow", "1e9"]].concat(), &["65535 s", "--slow"]);
    }
    let volume = ["slice", "ph/labels.nii.gz", "-o", "a.apng", "--axis", "z", "--at", "0"];
    refused(&volume, &["a.apng", "no frames", ".png"]);
    folder.yawara(&["mesh", "run", "-o", "m.stl"]).done();
    refused(&["render", "m.stl", "-o", "a.apng"], &["a.apng", ".png"]);
}
