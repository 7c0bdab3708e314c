//! Figures for print.

use crate::logs::{log, log_of_incidents, report};
use tiny_skia::Pixmap;

/// Share of the pixels that are not white.
fn ink(picture: &Pixmap) -> f64 {
    let inked = picture.pixels().iter().filter(|pixel| pixel.red().min(pixel.green()).min(pixel.blue()) < 200).count();
    inked as f64 / picture.pixels().len() as f64
}

#[test]
fn pictures_decode_and_are_not_blank() {
    let pictures = report(&log(1000, "realtime")).unwrap().pictures().unwrap();
    let mut names: Vec<_> = pictures.iter().map(|picture| picture.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["command", "contacts", "force", "objects", "overview", "position", "snapshots", "timing", "torque"]);
    for picture in &pictures {
        let pixmap = Pixmap::decode_png(&picture.png).unwrap();
        let size = (pixmap.width(), pixmap.height());
        match picture.name.as_str() {
            "overview" => assert_eq!(size, (1600, 1000)),
            // The height follows the scene.
            "snapshots" => assert!(size.0 == 2000 && (244..=724).contains(&size.1), "{size:?}"),
            _ => assert!(size.0 == 1600 && (300..3000).contains(&size.1), "{}: {size:?}", picture.name),
        }
        let ink = ink(&pixmap);
        assert!(ink > 0.002 && ink < 0.6, "{}: {ink}", picture.name);
    }
}

#[test]
fn snapshots_contain_box_in_its_colour() {
    let png = report(&log(1000, "realtime")).unwrap().snapshots().unwrap().unwrap();
    let pixmap = Pixmap::decode_png(&png).unwrap();
    let orange = |x: u32, y: u32| {
        pixmap.pixel(x, y).is_some_and(|p| p.red() > 100 && p.green() < p.red() && u16::from(p.blue()) * 3 < u16::from(p.red()))
    };
    for i in 0..5 {
        let found = (0..pixmap.height())
            .flat_map(|y| (400 * i..400 * (i + 1)).map(move |x| (x, y)))
            .filter(|(x, y)| orange(*x, *y))
            .count();
        assert!(found > 2000, "snapshot {i}: {found} pixels");
    }
}

#[test]
fn overview_contains_incident() {
    let red = |bytes: &[u8]| {
        let pictures = report(bytes).unwrap().pictures().unwrap();
        let overview = pictures.iter().find(|picture| picture.name == "overview").unwrap();
        let pixmap = Pixmap::decode_png(&overview.png).unwrap();
        assert_eq!((pixmap.width(), pixmap.height()), (1600, 1000));
        pixmap.pixels().iter().filter(|p| (p.red(), p.green(), p.blue()) == (213, 94, 0)).count()
    };
    // The desired force and the mark of a fault have the same colour: lines, no areas.
    let (with, without) = (red(&log_of_incidents()), red(&log(500, "lockstep")));
    assert!(with > without + 1000, "{with} and {without} pixels");
}

#[test]
fn pictures_are_written_into_new_folder() {
    let folder = tempfile::tempdir().unwrap();
    let figures = folder.path().join("deep/figures");
    let report = report(&log(50, "lockstep")).unwrap();
    let count = report.write_pictures(&figures).unwrap();
    assert_eq!(std::fs::read_dir(&figures).unwrap().count(), count);
    assert!(figures.join("overview.png").is_file());
}
