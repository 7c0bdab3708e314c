//! Commands of README.

use hapfic_tests::StackSandbox;

#[test]
fn readme_commands_succeed() {
    let readme = include_str!("../../README.md");
    // One command is a realtime run.
    let _lock = crate::realtime::realtime_lock();
    let stack = StackSandbox::new();
    let mut ran = 0;
    for line in readme.lines().filter_map(|l| l.strip_prefix("hapfic ")) {
        // Words as a shell would split them; README quotes with single quotes only.
        let mut words = Vec::new();
        for (i, part) in line.split('\'').enumerate() {
            if i % 2 == 1 {
                words.push(part.to_owned());
            } else {
                words.extend(part.split('#').next().unwrap().split_whitespace().map(str::to_owned));
            }
        }
        let mut words: Vec<&str> = words.iter().map(String::as_str).collect();
        let file = words.iter().position(|w| *w == ">").map(|at| (at, words[at + 1]));
        if let Some((at, _)) = file {
            words.truncate(at);
        }
        let end = stack.run(&words);
        end.expect(0);
        if let Some((_, name)) = file {
            std::fs::write(stack.path(name), &end.out).unwrap();
        }
        ran += 1;
    }
    assert!(ran >= 5, "README shows only {ran} commands");
}
