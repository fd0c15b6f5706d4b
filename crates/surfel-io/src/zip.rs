//! Reader of ZIP members, stored or deflated, by the directory at the file's end.

#![cfg_attr(not(all(feature = "gaussians", feature = "npy")), allow(dead_code))]

use crate::bytes::Bytes;
use crate::error::{Fault, Problem, quote};
use crate::files::{most_unpacked, most_unpacked_in_words, pour};
use flate2::read::DeflateDecoder;
#[cfg(feature = "gaussians")]
use std::borrow::Cow;
use std::io::Write;

/// Maximum factor by which deflate expands data. Members that state more are refused.
const DEFLATE_EXPANSION: u64 = 1032;
/// Maximum number of bytes of a ZIP file's directory; enough for 100,000 members. A file with a larger directory is
/// refused.
const DIRECTORY_BYTES: usize = 1 << 24;

/// A ZIP file with its directory of members.
pub(crate) struct Archive<'a> {
    bytes: Bytes<'a>,
    members: Vec<Member>,
    /// Number of bytes that may still be unpacked from this file, all members together.
    budget: u64,
}

struct Member {
    name: Vec<u8>,
    method: u16,
    encrypted: bool,
    packed: u64,
    whole: u64,
    /// Byte offset of the member's local header, which precedes its data.
    start: u64,
}

/// A member's data, which stay in the file until they are read.
pub(crate) enum Content<'a> {
    Stored(Bytes<'a>),
    Deflated(Deflated<'a>),
}

impl Content<'_> {
    /// Returns the member's size in bytes after unpacking.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Stored(bytes) => bytes.len(),
            Self::Deflated(packed) => packed.whole as usize,
        }
    }
}

/// A member that is compressed by deflate.
pub(crate) struct Deflated<'a> {
    bytes: Bytes<'a>,
    name: String,
    whole: u64,
}

impl Deflated<'_> {
    /// Unpacks the whole member.
    pub(crate) fn unpack(&self, out: &mut dyn Write) -> Result<(), Fault> {
        let (unpacked, failed) = pour(DeflateDecoder::new(self.bytes.reader()), self.whole + 1, out)?;
        if failed.is_some() || unpacked != self.whole {
            return Err(damaged(format!("{} in the ZIP file is damaged", self.name)));
        }
        Ok(())
    }

    /// Returns the member's first bytes after unpacking, at most `most`; fewer if the member is damaged.
    #[cfg(feature = "laz")]
    pub(crate) fn head(&self, most: usize) -> Vec<u8> {
        let mut head = Vec::new();
        let _ = pour(DeflateDecoder::new(self.bytes.reader()), most as u64, &mut head);
        head
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn damaged(what: impl Into<String>) -> Fault {
    Problem::new(what).help("copy or download the file again: it is incomplete or damaged").into()
}

impl<'a> Archive<'a> {
    pub(crate) fn of(bytes: Bytes<'a>) -> Result<Self, Fault> {
        let members = directory(bytes).ok_or_else(|| damaged("the ZIP file has no directory at its end"))?;
        Ok(Self { bytes, members, budget: most_unpacked(bytes.len()) })
    }

    /// Returns the names of all members, in the directory's order.
    pub(crate) fn names(&self) -> impl Iterator<Item = String> {
        self.members.iter().map(|m| String::from_utf8_lossy(&m.name).into_owned())
    }

    /// Returns the index of the member with this name, or `None` if there is none.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.members.iter().position(|m| m.name == name.as_bytes())
    }

    /// Reads a member into memory, unpacked.
    #[cfg(feature = "gaussians")]
    pub(crate) fn read(&mut self, index: usize) -> Result<Cow<'a, [u8]>, Fault> {
        Ok(match self.open(index)? {
            Content::Stored(bytes) => bytes.read(),
            Content::Deflated(packed) => {
                let mut content = Vec::new();
                packed.unpack(&mut content)?;
                content.into()
            }
        })
    }

    /// Returns a member's data in the file, stored or deflated. Its size and compression are checked first.
    pub(crate) fn open(&mut self, index: usize) -> Result<Content<'a>, Fault> {
        let member = self.members.get(index).ok_or_else(|| damaged("the ZIP file lacks a member"))?;
        let name = quote(&member.name);
        let data = data_of(self.bytes, member).ok_or_else(|| damaged(format!("the ZIP file ends within {name}")))?;
        if member.encrypted {
            return Err(Problem::new(format!("{name} in the ZIP file is encrypted")).help("unpack it first").into());
        }
        match member.method {
            0 => Ok(Content::Stored(data)),
            8 => {
                let backed = member.whole <= (member.packed + 1).saturating_mul(DEFLATE_EXPANSION);
                if !backed || member.whole > self.budget {
                    let what = format!("{name} in the ZIP file claims to be {} bytes long", member.whole);
                    return Err(Problem::new(what).expected(most_unpacked_in_words()).help("unpack it first").into());
                }
                self.budget -= member.whole;
                Ok(Content::Deflated(Deflated { bytes: data, name, whole: member.whole }))
            }
            method => {
                let problem = Problem::new(format!("{name} in the ZIP file is compressed by method {method}"));
                Err(problem.expected("stored (0) or deflated (8)").help("unpack it first").into())
            }
        }
    }
}

/// Returns the packed data of a member, which follow its local header.
fn data_of<'a>(bytes: Bytes<'a>, member: &Member) -> Option<Bytes<'a>> {
    let start = usize::try_from(member.start).ok()?;
    let local = bytes.at_most(start, 30);
    if u32_at(&local, 0)? != 0x0403_4b50 {
        return None;
    }
    let header = 30 + usize::from(u16_at(&local, 26)?) + usize::from(u16_at(&local, 28)?);
    let data = start.checked_add(header)?;
    bytes.part(data..data.checked_add(usize::try_from(member.packed).ok()?)?)
}

fn directory(bytes: Bytes<'_>) -> Option<Vec<Member>> {
    // The end record has 22 bytes and a comment of up to 65535 bytes.
    let tail_start = bytes.len().saturating_sub(22 + 65_535);
    let tail = bytes.at_most(tail_start, usize::MAX);
    let end = (0..tail.len().checked_sub(21)?).rev().find(|&at| u32_at(&tail, at) == Some(0x0605_4b50))?;
    let (mut count, mut start) = (u64::from(u16_at(&tail, end + 10)?), u64::from(u32_at(&tail, end + 16)?));
    if count == 0xffff || start == 0xffff_ffff {
        // ZIP64: a record of 20 bytes before it has the offset of the larger end record.
        let locator = (tail_start + end).checked_sub(20).map(|at| bytes.at_most(at, 20));
        if let Some(locator) = locator.filter(|locator| u32_at(locator, 0) == Some(0x0706_4b50)) {
            let larger = bytes.at_most(usize::try_from(u64_at(&locator, 8)?).ok()?, 56);
            if u32_at(&larger, 0)? != 0x0606_4b50 {
                return None;
            }
            (count, start) = (u64_at(&larger, 32)?, u64_at(&larger, 48)?);
        }
    }
    let all = bytes.at_most(usize::try_from(start).ok()?, DIRECTORY_BYTES);
    let mut rest = &all[..];
    let mut members = Vec::new();
    for _ in 0..count {
        if u32_at(rest, 0)? != 0x0201_4b50 {
            return None;
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| u16_at(rest, at).map(usize::from));
        let (name, extra, comment) = (name?, extra?, comment?);
        let mut member = Member {
            name: rest.get(46..46 + name)?.to_vec(),
            method: u16_at(rest, 10)?,
            encrypted: u16_at(rest, 8)? & 1 == 1,
            packed: u32_at(rest, 20)?.into(),
            whole: u32_at(rest, 24)?.into(),
            start: u32_at(rest, 42)?.into(),
        };
        widen(&mut member, rest.get(46 + name..46 + name + extra)?);
        members.push(member);
        rest = rest.get(46 + name + extra + comment..)?;
    }
    Some(members)
}

/// Replaces a member's sizes and offset that don't fit into 32 bits by those of its ZIP64 field.
fn widen(member: &mut Member, mut extra: &[u8]) {
    while let (Some(tag), Some(length)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let Some((mut field, after)) = extra[4..].split_at_checked(length.into()) else { return };
        if tag == 1 {
            for value in [&mut member.whole, &mut member.packed, &mut member.start] {
                if let (0xffff_ffff, Some(wide)) = (*value, u64_at(field, 0)) {
                    *value = wide;
                    field = &field[8..];
                }
            }
        }
        extra = after;
    }
}
