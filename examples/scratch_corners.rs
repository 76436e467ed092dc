use plumbline::corner::*;
use plumbline::image::GreyImage;
use std::time::Instant;
fn main() {
    let mut det = Box::new(Detector::new());
    let mut list = Box::new(CornerList::new());
    eprintln!("Detector {} list {}", size_of::<Detector>(), size_of::<CornerList>());
    for f in std::env::args().skip(1) {
        let im = image::open(&f).unwrap().to_luma8();
        let (w, h) = (im.width() as usize, im.height() as usize);
        let g = GreyImage::new(im.as_raw(), w, h, w).unwrap();
        let mut best = f64::MAX;
        for _ in 0..7 {
            list.clear();
            let t = Instant::now();
            det.detect(&g, 0..w, 0..h, &mut list);
            best = best.min(t.elapsed().as_secs_f64());
        }
        println!(
            "# {f} {w}x{h} {} corners dropped {} {:.2} ms",
            list.as_slice().len(),
            list.dropped(),
            best * 1e3
        );
        for c in list.as_slice() {
            println!(
                "{:.2} {:.2} {:.4} {:.3} {:.3} {}",
                c.position_px[0],
                c.position_px[1],
                c.score,
                c.edges_rad[0],
                c.edges_rad[1],
                c.radius_px
            );
        }
    }
}
