#![allow(missing_docs)]
use super::*;
use crate::scene::Scene;
macro_rules! ins { ($n:ident ($($a:ident : $t:ty),*)) => { pub struct $n; impl $n { pub fn new($($a:$t),*) -> Self { $(let _ = $a;)* $n } } impl Instrument for $n {
 fn device(&self)->Device{Device::Stage} fn take_request(&mut self,_:&mut Vec<u8>)->Option<Vec<u8>>{None} fn answer(&mut self,_:&[u8],_:&mut Scene,_:f64)->Vec<u8>{vec![]} } } }
ins!(ProcessStage(s:&Scene));
ins!(ProcessLoadCell());
ins!(ProcessArray());
