//! How deep a function's calls can go into the stack, computed from the compiler's output.
//!
//! The compiler writes the size of each function's frame into the section `.stack_sizes` of the
//! linked program, and the program's instructions show who calls whom. The depth is the largest sum
//! of frames from a function downwards. A jump to another function counts as a call, though the
//! frame may be gone by then.
//!
//! Panics are not counted: the core formats text only when it is about to stop. Functions from
//! elsewhere whose frame size is unknown, and calls through a pointer, count as nothing and are
//! listed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use petgraph::algo::tarjan_scc;
use petgraph::prelude::{Dfs, DiGraphMap};

use crate::command::Task;

pub mod table;

/// The compiler flags needed for this, with symbol names that every compiler mangles alike.
pub const RUSTFLAGS: &str = "-Zemit-stack-sizes -Csymbol-mangling-version=v0";

/// Recursion in Rust's own library, and how many calls deep it goes: any other recursion is
/// refused. Nothing sorts more than the 1,024 corners of a search.
const RECURSIONS: &[(&str, u64)] = &[
    // 2 log2(1024) times, plus the call that switches to heapsort.
    ("core::slice::sort::unstable::quicksort::quicksort", 21),
    // To an eighth of the slice each time, down to 8: 128, 16, 2.
    ("core::slice::sort::shared::pivot::median3_rec", 3),
    // To a twelfth each time, down to 16: 1024, 85, 7.
    ("core::slice::sort::select::median_of_medians", 3),
];

/// A call or a jump out of a function.
struct Branch {
    from: u64,
    to: u64,
    is_call: bool,
}

/// The functions of a program by their addresses.
#[derive(Default)]
pub struct Program {
    names: BTreeMap<u64, String>,
    frames: BTreeMap<u64, u64>,
    calls: DiGraphMap<u64, ()>,
    /// The functions that call through a pointer.
    callers_unknown: BTreeSet<u64>,
}

/// The deepest path.
#[derive(Debug, PartialEq)]
pub struct Deepest {
    /// Its levels, from the outermost function on.
    pub levels: Vec<Level>,
    /// What is called somewhere below but counts as nothing.
    pub uncounted: BTreeSet<String>,
}

/// A function on the path.
#[derive(Debug, PartialEq)]
pub struct Level {
    /// Its name, and how many times it calls itself.
    pub name: String,
    /// The size of all its frames.
    pub bytes: u64,
}

impl Deepest {
    /// The sum over all levels.
    pub fn bytes(&self) -> u64 {
        self.levels.iter().map(|level| level.bytes).sum()
    }
}

/// The properties of a processor that matter here.
#[derive(Clone, Copy)]
pub struct Processor {
    /// The prefix of the names of its binutils.
    pub binutils: &'static str,
    pub address_bytes: usize,
    /// The number of bytes that a call itself puts on the stack.
    pub call_bytes: u64,
}

impl Program {
    /// Reads a linked program.
    pub fn read(program: &Path, processor: &Processor) -> Result<Self> {
        let tool = |name| Task::new(format!("{}{name}", processor.binutils));
        let disassembly = tool("objdump")
            .args(["--disassemble", "--demangle", "--no-show-raw-insn"])
            .args([program])
            .output()?;
        let [sizes, copy] = ["stack_sizes", "copy"].map(|name| program.with_extension(name));
        tool("objcopy")
            .args(["--dump-section", &format!(".stack_sizes={}", sizes.display())])
            .args([program, &copy])
            .output()?;
        fs::remove_file(&copy).with_context(|| copy.display().to_string())?;
        let sizes = fs::read(&sizes).with_context(|| sizes.display().to_string())?;
        let symbols = tool("nm").args(["--print-size"]).args([program]).output()?;
        Ok(Self::of(&disassembly, frames(&sizes, processor)?, &ends(&symbols)))
    }

    /// From objdump's output, the size of each function's call and frame, and where functions end.
    ///
    /// A linker may put code between two functions, such as what stands in for one instruction that
    /// a processor would get wrong: it is entered and left by jumps, which are not followed.
    fn of(disassembly: &str, frames: BTreeMap<u64, u64>, ends: &BTreeMap<u64, u64>) -> Self {
        let is_within =
            |place: u64, function: &u64| ends.get(function).is_none_or(|&end| place < end);
        let mut this = Self { frames, ..Self::default() };
        let mut branches = Vec::new();
        let mut function = 0;
        let mut has_loaded = false;
        for line in disassembly.lines() {
            if let Some((address, name)) = header(line) {
                function = address;
                has_loaded = false;
                this.names.insert(address, name.to_owned());
            } else if let Some((to, name)) = load(line) {
                has_loaded = true;
                this.names.insert(to, name.to_owned());
                branches.push(Branch { from: function, to, is_call: true });
            } else if let Some((place, is_call, operands)) = branch(line) {
                if let Some((to, name)) = target(operands) {
                    if !is_call && !is_within(place, &function) {
                        continue;
                    }
                    if operands.starts_with('*') {
                        // In a shared library, the call goes through a table that the loader fills.
                        this.names.insert(to, name.to_owned());
                    }
                    branches.push(Branch { from: function, to, is_call });
                } else if is_call && !(has_loaded && operands.starts_with("*%")) {
                    this.callers_unknown.insert(function);
                }
                // Other jumps through a pointer are those of a `match`, within the function.
            }
        }
        for Branch { from, to, is_call } in branches {
            let Some((&callee, name)) = this.names.range(..=to).next_back() else { continue };
            let is_followed = is_call || (callee != from && is_within(to, &callee));
            if is_followed && !is_panic(name) {
                this.calls.add_edge(from, callee, ());
            }
        }
        this
    }

    /// The deepest path from the function of this name.
    pub fn deepest_from(&self, name: &str) -> Result<Deepest> {
        let root = self.names.iter().find(|(_, one)| *one == name);
        let (&root, _) = root.with_context(|| format!("the program has no function {name}"))?;
        let mut reached = BTreeSet::new();
        let mut search = Dfs::new(&self.calls, root);
        while let Some(function) = search.next(&self.calls) {
            reached.insert(function);
        }
        let mut below = BTreeMap::<u64, Depth>::new();
        // Functions that call each other form one component, which comes after those that they
        // call.
        for functions in tarjan_scc(&self.calls) {
            if functions.iter().all(|function| reached.contains(function)) {
                let level = self.level(&functions)?;
                let callees = functions.iter().flat_map(|&one| self.calls.neighbors(one));
                let next = callees.filter(|callee| !functions.contains(callee));
                let next = next.max_by_key(|callee| below[callee].bytes);
                let bytes = level.bytes + next.map_or(0, |callee| below[&callee].bytes);
                for &function in &functions {
                    let level = Level { name: level.name.clone(), ..level };
                    below.insert(function, Depth { bytes, level, next });
                }
            }
        }
        let mut levels = Vec::new();
        let mut place = Some(root);
        while let Some(depth) = place.and_then(|function| below.remove(&function)) {
            // A function that keeps everything in registers, or whose frame is unknown, adds
            // nothing.
            levels.extend((depth.level.bytes > 0).then_some(depth.level));
            place = depth.next;
        }
        let mut uncounted = BTreeSet::new();
        for function in &reached {
            let name = short(&self.names[function]);
            if self.callers_unknown.contains(function) {
                uncounted.insert(format!("a pointer in {name}"));
            }
            if !self.frames.contains_key(function) {
                uncounted.insert(name);
            }
        }
        Ok(Deepest { levels, uncounted })
    }

    /// The level of one function, or of several that call each other.
    fn level(&self, functions: &[u64]) -> Result<Level> {
        let own = functions.iter().filter_map(|function| self.frames.get(function)).sum::<u64>();
        let names: Vec<&str> = functions.iter().map(|one| self.names[one].as_str()).collect();
        let name = names.iter().map(|name| short(name)).collect::<Vec<_>>().join(" and ");
        if functions.len() == 1 && !self.calls.contains_edge(functions[0], functions[0]) {
            return Ok(Level { name, bytes: own });
        }
        let known =
            RECURSIONS.iter().find(|(known, _)| names.iter().any(|one| one.starts_with(known)));
        let Some((_, times)) = known else {
            bail!(
                "{name}: recursion of unknown depth. Write a loop instead, or, if it is \
                 in Rust's library, add the bound to RECURSIONS in host-tools/xtask/src/stack.rs"
            );
        };
        Ok(Level { name: format!("{name}, {times} deep"), bytes: times * own })
    }
}

/// The stack below a function, including the function itself.
struct Depth {
    bytes: u64,
    level: Level,
    next: Option<u64>,
}

/// Parses the section `.stack_sizes`: an address and a number in LEB128 for each function.
fn frames(section: &[u8], processor: &Processor) -> Result<BTreeMap<u64, u64>> {
    let mut frames = BTreeMap::new();
    let mut rest = section;
    while !rest.is_empty() {
        let (address, after) = rest
            .split_at_checked(processor.address_bytes)
            .context("the section .stack_sizes ends within an address")?;
        let address = address.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte));
        let length = after.iter().take_while(|&byte| byte & 0x80 != 0).count() + 1;
        let (number, after) = after
            .split_at_checked(length)
            .context("the section .stack_sizes ends within a number")?;
        let bytes = number.iter().rev().fold(0, |value, &byte| value << 7 | u64::from(byte & 0x7f));
        frames.insert(address, processor.call_bytes + bytes);
        rest = after;
    }
    Ok(frames)
}

/// The first line of a function: `0000000000001130 <core::slice::sort>:`.
fn header(line: &str) -> Option<(u64, &str)> {
    let (address, name) = line.strip_suffix(">:")?.split_once(" <")?;
    Some((u64::from_str_radix(address, 16).ok()?, own_name(name)))
}

/// The address behind each symbol with a size, from lines of `nm` such as
/// `0000000000001130 0000000000000020 t name`.
fn ends(symbols: &str) -> BTreeMap<u64, u64> {
    let end = |line: &str| {
        let [start, bytes, _kind, _name] = line.split(' ').collect::<Vec<_>>()[..] else {
            return None;
        };
        let [start, bytes] = [start, bytes].map(|word| u64::from_str_radix(word, 16).ok());
        Some((start?, start? + bytes?))
    };
    symbols.lines().filter_map(end).collect()
}

/// The address of an instruction such as `    1130:\tbl\t2260 <memcpy>`, whether it is a call or a
/// jump, and its operands.
fn branch(line: &str) -> Option<(u64, bool, &str)> {
    let (address, instruction) = line.split_once(":\t")?;
    let address = u64::from_str_radix(address.trim_start(), 16).ok()?;
    let (name, operands) = instruction.split_once(char::is_whitespace)?;
    let is_call = matches!(name, "call" | "bl" | "blr" | "blx");
    // Includes conditional ones: jne, b.ne, bne.w, cbz, tbnz.
    let is_jump = ["j", "b", "cb", "tb"].iter().any(|start| name.starts_with(start));
    (is_call || is_jump).then(|| (address, is_call, operands.trim_start()))
}

/// The target of a branch: `2260 <memcpy>` at the end of the operands.
fn target(operands: &str) -> Option<(u64, &str)> {
    let (before, name) = operands.strip_suffix('>')?.split_once(" <")?;
    let address = before.rsplit([' ', '\t']).next()?;
    Some((u64::from_str_radix(address, 16).ok()?, own_name(name)))
}

/// A shared library's function whose address is loaded into a register, to be called more than
/// once: `    1130:\tmov    0x5a528(%rip),%rbp        # 9a048 <memcpy@GLIBC_2.14>`. Calls through
/// registers in the same function are attributed to it; the registers are not tracked.
fn load(line: &str) -> Option<(u64, &str)> {
    let (_, instruction) = line.split_once(":\tmov ")?;
    instruction.contains('@').then(|| target(instruction))?
}

/// A name without its library's version, or the way it is reached: `memcpy@plt`.
fn own_name(name: &str) -> &str {
    name.split('@').next().unwrap_or(name)
}

/// Whether this is a function of the library that ends a program.
fn is_panic(name: &str) -> bool {
    name.starts_with("core::")
        && (name.contains("panic") || name.ends_with("_fail") || name.ends_with("_failed"))
}

/// A name without its generic arguments: `<a::B<C> as D>::e::<F>` is `a::B::e`.
fn short(name: &str) -> String {
    let qualified = name.strip_prefix('<').and_then(|rest| {
        let end = rest.char_indices().scan(1, |depth, (place, character)| {
            *depth += nesting(character);
            Some((place, *depth))
        });
        let (end, _) = end.into_iter().find(|(_, depth)| *depth == 0)?;
        Some((&rest[..end], &rest[end + 1..]))
    });
    let (own, rest) = qualified.unwrap_or(("", name));
    let own = without_arguments(own);
    let own = own.split(" as ").next().unwrap_or_default();
    format!("{own}{}", without_arguments(rest))
}

fn without_arguments(name: &str) -> String {
    let mut depth = 0;
    let mut kept = String::new();
    for character in name.replace("->", "to").chars() {
        let change = nesting(character);
        if depth == 0 && change == 0 {
            kept.push(character);
        }
        depth += change;
    }
    kept.replace("::::", "::").trim_end_matches("::").to_owned()
}

fn nesting(character: char) -> i32 {
    i32::from(character == '<') - i32::from(character == '>')
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function of each letter with a frame of 10, 20, 30, ... bytes; `calls` are pairs of them.
    fn program(functions: &str, calls: &[&str]) -> Program {
        let address = |letter: u8| u64::from(letter - b'a' + 1) * 16;
        let mut text = String::new();
        for &function in functions.as_bytes() {
            text += &format!("{:016x} <{}>:\n", address(function), char::from(function));
            for call in calls.iter().filter(|call| call.as_bytes()[0] == function) {
                let callee = call.as_bytes()[1];
                text += &format!("  10:\tcall   {:x} <{}>\n", address(callee), &call[1..]);
            }
        }
        let frame = |&letter: &u8| (address(letter), u64::from(letter - b'a' + 1) * 10);
        Program::of(&text, functions.as_bytes().iter().map(frame).collect(), &BTreeMap::new())
    }

    fn path(deepest: &Deepest) -> Vec<(&str, u64)> {
        deepest.levels.iter().map(|level| (level.name.as_str(), level.bytes)).collect()
    }

    #[test]
    fn the_deepest_path_is_not_the_longest() {
        let deepest = program("abcdef", &["ab", "bc", "cd", "af", "ef"]).deepest_from("a").unwrap();
        assert_eq!(path(&deepest), [("a", 10), ("b", 20), ("c", 30), ("d", 40)]);
        let deepest = program("abcdef", &["ab", "bc", "af"]).deepest_from("a").unwrap();
        assert_eq!(path(&deepest), [("a", 10), ("f", 60)]);
        assert_eq!(deepest.bytes(), 70);
        assert!(deepest.uncounted.is_empty());
    }

    #[test]
    fn recursion_is_named_where_it_can_be_reached() {
        let recursive = program("abcd", &["ab", "bc", "cb", "dd"]);
        let error = recursive.deepest_from("a").unwrap_err().to_string();
        assert!(error.contains("b and c") || error.contains("c and b"), "{error}");
        let error = recursive.deepest_from("d").unwrap_err().to_string();
        assert!(error.starts_with("d:"), "{error}");
        assert_eq!(program("abd", &["ab", "dd"]).deepest_from("a").unwrap().bytes(), 30);
        assert!(recursive.deepest_from("z").is_err());
    }

    #[test]
    fn the_librarys_own_recursion_counts_as_deep_as_it_goes() {
        let mut sorting = program("ab", &["ab", "bb"]);
        sorting.names.insert(32, format!("{}::<u16>", RECURSIONS[0].0));
        let deepest = sorting.deepest_from("a").unwrap();
        assert_eq!(deepest.bytes(), 10 + 21 * 20);
        assert!(deepest.levels[1].name.ends_with("quicksort, 21 deep"), "{deepest:?}");
    }

    #[test]
    fn what_counts_nothing_is_named() {
        let text = "0000000000000010 <a>:\n  10:\tcall   *0x10(%rip)        # 50 <memcpy@GLIBC_2.14>\n  \
                    14:\tcall   *%rax\n  16:\tjmp    *%rax\n  18:\tjmp    14 <a+0x4>\n  \
                    1a:\tcall   40 <core::panicking::panic_fmt>\n\
                    0000000000000040 <core::panicking::panic_fmt>:\n";
        let deepest =
            Program::of(text, [(16, 8)].into(), &BTreeMap::new()).deepest_from("a").unwrap();
        assert_eq!(path(&deepest), [("a", 8)]);
        assert_eq!(Vec::from_iter(&deepest.uncounted), ["a pointer in a", "memcpy"]);
        let text = "0000000000000010 <a>:\n  10:\tmov    0x10(%rip),%rbp        # 50 <memset@GLIBC_2.2.5>\n  \
                    14:\tcall   *%rbp\n  16:\tmov    0x20(%rip),%rax        # 60 <a::TABLE>\n";
        let deepest =
            Program::of(text, [(16, 8)].into(), &BTreeMap::new()).deepest_from("a").unwrap();
        assert_eq!(Vec::from_iter(&deepest.uncounted), ["memset"]);
    }

    /// What GNU ld does about erratum 843419 of the Cortex-A53: a jump past all such code, and an
    /// instruction of `a` and one of `b`, each with the jump back.
    #[test]
    fn what_a_linker_puts_between_functions_is_of_none() {
        let text = "0000000000000010 <a>:\n  10:\tbl\t50 <b>\n  14:\tb\t28 <a+0x18>\n  18:\tret\n  \
                    20:\tb\t50 <b>\n  24:\tnop\n  28:\tldr\td2, [x9, #648]\n  2c:\tb\t18 <a+0x8>\n  \
                    30:\tldr\td2, [x9, #648]\n  34:\tb\t58 <b+0x8>\n\
                    0000000000000050 <b>:\n  50:\tnop\n  54:\tb\t30 <a+0x20>\n  58:\tret\n";
        let symbols = "0000000000000010 000000000000000c t a\n0000000000000050 000000000000000c T b\n\
                       0000000000000080 A end\n";
        let read = |ends| Program::of(text, [(0x10, 8), (0x50, 16)].into(), &ends);
        assert_eq!(ends(symbols), BTreeMap::from([(0x10, 0x1c), (0x50, 0x5c)]));
        let deepest = read(ends(symbols)).deepest_from("a").unwrap();
        assert_eq!(path(&deepest), [("a", 8), ("b", 16)]);
        // Otherwise `b` calls `a`.
        assert!(read(BTreeMap::new()).deepest_from("a").is_err());
    }

    #[test]
    fn branches_of_each_processor_are_read() {
        for (line, is_call, to) in [
            ("  10:\tcall   2260 <a::b<c>::d>", true, Some(0x2260)),
            ("  10:\tbl\t2260 <memcpy>", true, Some(0x2260)),
            ("  10:\tblr\tx8", true, None),
            ("  10:\ttbnz\tw0, #0, 2260 <a+0x4>", false, Some(0x2260)),
            ("  10:\tbne.w\t2260 <a+0x4>", false, Some(0x2260)),
        ] {
            let (address, call, operands) = branch(line).expect(line);
            assert_eq!(address, 0x10);
            assert_eq!((call, target(operands).map(|(to, _)| to)), (is_call, to), "{line}");
        }
        assert_eq!(branch("  10:\tadrp\tx0, 2000 <a>"), None);
        assert_eq!(header("0000000000001130 <a::<b>>:"), Some((0x1130, "a::<b>")));
    }

    #[test]
    fn frames_are_addresses_and_numbers_of_any_length() {
        let processor = Processor { binutils: "", address_bytes: 4, call_bytes: 8 };
        let section = [0x10, 0, 0, 0x40, 0x05, 0x20, 0, 0, 0x40, 0xe5, 0x8e, 0x26];
        let read = frames(&section, &processor).unwrap();
        assert_eq!(read, BTreeMap::from([(0x4000_0010, 13), (0x4000_0020, 624_493)]));
        assert!(frames(&section[..11], &processor).is_err());
        assert!(frames(&section[..7], &processor).is_err());
    }

    #[test]
    fn names_are_shortened() {
        for (name, expected) in [
            ("<a::B<C<D>> as e::F<g::H>>::i::<J, <K as L>::M>", "a::B::i"),
            ("<a::B>::c::<u8>::{closure#1}", "a::B::c::{closure#1}"),
            ("a::b::<fn(u8) -> u8>", "a::b"),
            ("memcpy", "memcpy"),
        ] {
            assert_eq!(short(name), expected);
        }
    }
}
