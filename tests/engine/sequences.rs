//! Sequences of frames.

use pinspot::{Backend, DisplaySettings, Exposure, NoProgress, Options, Sequence, SequenceReport};

fn render(sequence: &Sequence, options: Options) -> SequenceReport {
    render_by("this code", sequence, options)
}

/// Not more than one poll: the CPU makes nobody wait.
fn render_by(code: &str, sequence: &Sequence, options: Options) -> SequenceReport {
    let (scene, _) = pinspot::load("ring").unwrap();
    let backend = Backend::cpu();
    let mut ignore = |_: &SequenceReport| ();
    let mut rendering = std::pin::pin!(sequence.render(scene, options, &backend, code, &NoProgress, &mut ignore));
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match rendering.as_mut().poll(&mut context) {
        std::task::Poll::Ready(report) => report.unwrap(),
        std::task::Poll::Pending => panic!("the CPU has nothing to wait for"),
    }
}

#[test]
fn an_interrupted_sequence_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let outputs = vec![dir.path().join("f-##.png"), dir.path().join("f-##.exr")];
    let sequence = Sequence::new(2..6, 4, outputs).unwrap();
    let exposure = DisplaySettings { exposure: Exposure::Auto, ..Default::default() };
    let options = Options::default().with_size([16, 12]).with_samples(20).with_display(exposure);
    let report = render(&sequence, options.clone());
    assert_eq!((report.rendered, report.kept), (4, 0));
    let whole: Vec<Vec<u8>> = (2..6).map(|k| std::fs::read(&sequence.files(k)[0]).unwrap()).collect();
    assert_ne!(whole[0], whole[3], "the scene moves");
    std::fs::remove_file(&sequence.files(3)[1]).unwrap();
    std::fs::write(&sequence.files(5)[0], &whole[3][..100]).unwrap();
    let report = render(&sequence, options.clone());
    assert_eq!((report.rendered, report.kept), (2, 2), "a file was missing, and one was cut off");
    let again: Vec<Vec<u8>> = (2..6).map(|k| std::fs::read(&sequence.files(k)[0]).unwrap()).collect();
    assert!(again == whole, "with the same exposure");
    let options = options.with_seed(2);
    assert_eq!(render(&sequence, options.clone()).rendered, 4, "other options, other frames");
    assert_eq!(render_by("other code", &sequence, options.clone()).rendered, 4, "other code, other frames");
    assert_eq!(render_by("other code", &sequence, options).kept, 4, "now they are its own");
}
